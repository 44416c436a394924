"""What no-depth pixels do to a robot's task: objects re-aligned by iterative closest points."""
