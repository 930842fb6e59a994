"""Forward dynamics of many states side by side: `masses`, `loads` and `equations`, in lanes."""
