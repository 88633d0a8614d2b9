"""The studio: pages that the service gives to a browser, where textures are felt, made and tested.

The pages are static ES modules without a build step; `haptix.service.front.application` serves
them. They use the service through the client for pages, like any app, and can do no more than an
app can.
"""
