"""Causal InfoGAN in the report (Sec. VII-C, Fig. 8): its records, figures and verdict."""
