"""The third baseline: Causal InfoGAN (Kurutach et al. 2018) on rope shapes (Sec. VII-C, Fig. 8).

A generative-adversarial network makes pairs of consecutive rope shapes from codes that follow a
Gaussian transition. A plan is a straight line in the code space between the projections of a given
start and a given end shape, decoded into rope shapes. It is no sampler: it requires the end shape,
and returns shapes but no robot motion.
"""
