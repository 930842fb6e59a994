"""The equations of a floating arm, each written once, as array code without branches."""
