"""MuJoCo models as scenes, and depth cameras in them. Needs the package `mujoco`."""
