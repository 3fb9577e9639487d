"""Proposed splines on unseen ropes in the report, to look at: their records and their figure."""
