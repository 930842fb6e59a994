"""The page in the browser: its scene, its panel and its server."""
