"""A local service: any app, in any language, on this machine; see `haptix serve`."""
