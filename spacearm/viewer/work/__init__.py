"""Work: what takes long is computed in a process of its own, while the page goes on."""
