"""Rendering as a module on top of the store: jobs, passes, films, the pool, and the renderers behind one contract."""
