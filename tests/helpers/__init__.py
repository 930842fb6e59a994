"""What tests share: robots, references, studies."""
