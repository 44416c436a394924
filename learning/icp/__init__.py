"""Effect of no-depth pixels on a robot's task: aligning objects by iterative closest points."""
