"""Learned rope dynamics: training, and prediction errors on unseen ropes (Sec. VI)."""

from __future__ import annotations

from pathlib import Path

from knotflow.execution import (
    DynamicsTrainer,
    DynamicsTrainingConfig,
    LstmDynamics,
    Motions,
    MujocoDynamics,
    StaticDynamics,
    draw_motions,
    prediction_errors,
)
from knotflow.execution.dynamics import RopeDynamics
from knotflow.experiments.common import train
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.seeding import rng_of
from knotflow.simulation import LEVELS, SimulationConfig
from knotflow.workflow import StageRun, stage

MOTIONS, WEIGHTS = "motions.npz", "dynamics.safetensors"


@stage
def motions(
    run: StageRun,
    *,
    demonstrations_file: Path,
    simulation: SimulationConfig,
    ropes: int,
    per_rope: int,
    seed: int,
) -> None:
    """Perturbed ropes dragged by a gripper along demonstrated, planned and random splines.

    Makes motions.npz, see `execution.Motions`; one shard a rope.
    """
    shards = [f"shard-{number:04d}.npz" for number in range(ropes)]
    demonstrations = load_demonstrations(demonstrations_file)

    def drag(shard: str) -> None:
        number = shards.index(shard)
        level, rng = LEVELS[number % len(LEVELS)], rng_of(seed, number)
        drawn = draw_motions(demonstrations, simulation, level, per_rope, rng)
        with run.atomic(shard) as path:
            drawn.save(path)

    run.each(drag, run.pending(shards), "ropes")
    with run.atomic(MOTIONS) as path:
        Motions.join([Motions.load(run.out / shard) for shard in shards]).save(path)
    for shard in shards:
        (run.out / shard).unlink()


@stage
def dynamics_training(
    run: StageRun, *, motions: Path, training: DynamicsTrainingConfig, seed: int
) -> None:
    """A network learns how ropes move with a gripper.

    Makes dynamics.safetensors, in half precision, and curves.csv.
    """
    trainer = DynamicsTrainer(Motions.load(motions / MOTIONS), training, seed)
    train(run, trainer, "dynamics", WEIGHTS, trainer.model.save)


@stage
def dynamics(
    run: StageRun, *, motions: Path, dynamics_weights: Path, simulation: SimulationConfig
) -> None:
    """How far predictions are off. Makes errors.csv, a row a model, level and number of steps."""
    models: dict[str, RopeDynamics] = {
        "still": StaticDynamics(),
        "lstm": LstmDynamics.load(dynamics_weights),
        "mujoco": MujocoDynamics(simulation),
    }
    run.save_table("errors.csv", prediction_errors(models, Motions.load(motions / MOTIONS)))
