from __future__ import annotations

import torch

from knotflow.samplers.primitives.encoding import STREAM_POINTS, control_features
from knotflow.training.augmentation import AugmentationConfig, augment
from knotflow.training.learner import demonstration_buffer


def test_a_copy_is_the_same_trial_seen_from_another_frame(trials):
    generator = torch.Generator().manual_seed(0)
    buffer = demonstration_buffer([(trials, trials.start >= 0)], generator)
    batch = buffer.sample(6, 10)
    before = batch.clone()
    copy = augment(batch, AugmentationConfig(turn=1.0, shift=1.0), generator)
    torch.testing.assert_close(batch["spline"], before["spline"])  # untouched
    assert not torch.allclose(copy["spline"], batch["spline"], atol=0.1)

    def distances(some):
        """From middle and end point to every point of the spline's rope."""
        rope = some["states"]["streams"][some["owner"]][:, -STREAM_POINTS[-1] :, :2]
        spline = some["spline"]
        return torch.cat([(rope - spline[:, None, k : k + 2]).norm(dim=-1) for k in (1, 4)], dim=1)

    torch.testing.assert_close(distances(copy), distances(batch), atol=1e-4, rtol=1e-4)
    kept = [0, 3]
    torch.testing.assert_close(copy["spline"][:, kept], batch["spline"][:, kept])

    def held(some):
        """Where the grasped point's direction points, seen from the middle control point."""
        features = control_features(some["states"][some["owner"]], some["spline"][:, None])[:, 0]
        arm = features[:, 7:9] - some["spline"][:, 1:3]
        return (arm * features[:, 10:12]).sum(dim=1)

    torch.testing.assert_close(held(copy), held(batch), atol=1e-4, rtol=1e-4)
