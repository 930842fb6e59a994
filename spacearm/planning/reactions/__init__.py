"""What a joint motion does to its spacecraft, bounded between the rows too."""
