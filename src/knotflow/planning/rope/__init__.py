"""The rope to plan for: files of measured ropes, their size, and the model rope that lies there."""
