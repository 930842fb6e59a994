"""Plans of a spacecraft whose attitude wheels hold, within what these can take."""
