"""The page in the browser: scene, panel, server."""
