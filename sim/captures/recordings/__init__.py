"""Import of recordings: bags, folders of images, and their checks."""
