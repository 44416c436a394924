"""A second camera, written from the effects' pages alone, to check what diagnosis finds.

It turns linear light into infrared pairs by formulas of its own, so that a diagnosis that knows the
simulator's formulas cannot find its own work again. Nothing in here reads the simulator but for the
shape of its captures (`starling.sim.captures.capture`); a test holds that wall.
"""
