"""The third baseline: Causal InfoGAN (Kurutach et al. 2018) on rope shapes (Sec. VII-C, Fig. 8).

A generative-adversarial network makes pairs of consecutive rope shapes from codes that follow a
Gaussian transition. It is no sampler: it requires the end shape and returns no robot motion.
"""
