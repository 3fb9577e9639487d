"""Scalars over time, through TorchRL's loggers.

Metrics are a view of the work while it runs. They are switched off or sent elsewhere without
touching any result, so a stage writes the numbers it is asked for into its own output as well.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

DEFAULT_METRICS = "csv+tensorboard"


class Metrics:
    """One or several TorchRL loggers behind two methods; none at all is fine too."""

    def __init__(self, loggers: tuple[Any, ...], closing: ExitStack) -> None:
        self.loggers = loggers
        """The TorchRL loggers, for what needs one itself."""
        self._closing = closing

    def log_scalar(self, name: str, value: float, step: int) -> None:
        """Adds one point to the curve `name`."""
        for logger in self.loggers:
            logger.log_scalar(name, float(value), step=step)

    def log_hparams(self, hparams: Mapping[str, Any]) -> None:
        """Records the hyper-parameters; nested mappings get dotted keys."""
        flat = flatten(hparams)
        for logger in self.loggers:
            logger.log_hparams(dict(flat))

    def close(self) -> None:
        """Writes what is held back and closes the files."""
        self.loggers = ()
        self._closing.close()


def open_metrics(kind: str, folder: Path, name: str) -> Metrics:
    """Opens the loggers of `kind` for the run `name` (may contain slashes).

    csv lies in folder/csv/name, tensorboard in folder/tensorboard/name. mlflow goes where
    MLFLOW_TRACKING_URI points, else into folder/mlflow.db. wandb stays offline, in folder/wandb,
    unless WANDB_MODE says otherwise.

    Raises:
        ValueError: no such kind, or one whose package is not installed; lists those there are.
    """
    check_metrics(kind)
    closing = ExitStack()
    return Metrics(tuple(open_(folder, name, closing) for open_ in _KINDS[kind]), closing)


def check_metrics(kind: str) -> None:
    """Raises what `open_metrics` would, before any work is done."""
    if kind not in _KINDS:
        raise ValueError(f"unknown metrics {kind!r}; choose one of: {', '.join(_KINDS)}")
    for open_ in _KINDS[kind]:
        package = _NEEDS.get(open_)
        if package and importlib.util.find_spec(package) is None:
            raise ValueError(
                f"metrics {kind!r} need the package {package}, which is not installed: "
                f"pip install 'knotflow[{package}]', or choose another of: {', '.join(_KINDS)}"
            )


def flatten(nested: Mapping[str, Any], prefix: str = "") -> dict[str, str | int | float | bool]:
    """Dotted keys; values that a logger cannot hold as they are become text."""
    flat: dict[str, str | int | float | bool] = {}
    for key, value in nested.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = (
                value if isinstance(value, str | int | float | bool) else str(value)
            )
    return flat


def _csv(folder: Path, name: str, closing: ExitStack) -> Any:
    from torchrl.record.loggers import CSVLogger

    logger = CSVLogger(exp_name=name, log_dir=str(folder / "csv"))

    def close() -> None:  # TorchRL leaves it to the garbage collector
        for file in logger.experiment.files.values():
            file.close()

    closing.callback(close)
    return logger


def _tensorboard(folder: Path, name: str, closing: ExitStack) -> Any:
    from torchrl.record.loggers import TensorboardLogger

    logger = TensorboardLogger(exp_name=name, log_dir=str(folder / "tensorboard"))
    closing.callback(logger.experiment.close)
    return logger


def _mlflow(folder: Path, name: str, closing: ExitStack) -> Any:
    import mlflow
    from torchrl.record.loggers.mlflow import MLFlowLogger

    folder.mkdir(parents=True, exist_ok=True)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{folder.absolute()}/mlflow.db"
    logger = MLFlowLogger(exp_name=name, tracking_uri=uri)
    closing.callback(mlflow.end_run)  # or the next stage's run would not start
    return logger


def _wandb(folder: Path, name: str, closing: ExitStack) -> Any:
    import wandb
    from torchrl.record.loggers.wandb import WandbLogger

    folder.mkdir(parents=True, exist_ok=True)
    # TorchRL writes "dryrun", the older word for offline, into the variable.
    offline = os.environ.get("WANDB_MODE", "offline") in ("offline", "dryrun")
    logger = WandbLogger(
        exp_name=name,
        offline=offline,
        save_dir=str(folder),
        project="knotflow",
        settings=wandb.Settings(silent=True),
    )
    closing.callback(logger.experiment.finish)
    return logger


_Open = Callable[[Path, str, ExitStack], Any]
_KINDS: dict[str, tuple[_Open, ...]] = {
    "csv": (_csv,),
    "tensorboard": (_tensorboard,),
    "csv+tensorboard": (_csv, _tensorboard),
    "mlflow": (_mlflow,),
    "wandb": (_wandb,),
    "none": (),
}
_NEEDS: dict[_Open, str] = {_tensorboard: "tensorboard", _mlflow: "mlflow", _wandb: "wandb"}
"""The package that a kind needs, which is the name of its extra as well."""
