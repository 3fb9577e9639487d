"""Learning curves of imitation and reinforcement in the report: their records and figures."""
