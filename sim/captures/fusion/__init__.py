"""An RGB-D stream fused to a surface, and seen again as the reference of its own frames."""
