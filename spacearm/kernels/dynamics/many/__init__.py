"""Forward dynamics of many states side by side: `masses` and `equations`, in lanes."""
