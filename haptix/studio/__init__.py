"""The studio: pages that the service gives to a browser, where textures are felt, made and tested.

The pages are static ES modules without build step; `haptix.service.pages` serves them. They reach
the service by the client for pages, like any app, and hold nothing that an app could not do.
"""
