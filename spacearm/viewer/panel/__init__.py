"""Panel: what stands beside the drawing, as plain data for JSON; no browser and no drawing."""
