"""Depth images of many environments, corrupted on one device by NVIDIA Warp kernels."""
