"""The studio: pages that the service gives to a browser, where textures are felt, made and tested.

The pages are static ES modules without build step. They reach the service by the client for pages,
like any app, and hold nothing of their own that an app could not do.
"""
