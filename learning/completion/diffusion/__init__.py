"""Depth completion by latent diffusion that is told image and sensor depth.

Source: Cuaran, Mai, Ahluwalia and Wu, Enhancing stereo depth maps through RGBD-conditioned
generative models (University of Illinois, 2024), after Marigold (Ke et al., CVPR 2024).
"""
