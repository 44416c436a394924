"""How far the gap shrinks once an effect is in, on scenes that had no say in it."""
