"""How far accepted effects close the gap on held-out scenes."""
