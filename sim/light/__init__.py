"""From rendered layers to the light that reaches an imager."""
