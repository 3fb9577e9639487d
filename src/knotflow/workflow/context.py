"""What a running stage is given besides its configuration and inputs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knotflow.threads import one_thread

from . import durable
from .progress import progress
from .workers import WorkersConfig, each

if TYPE_CHECKING:
    import pandas as pd
    from tqdm import tqdm

    from .metrics import Metrics


@dataclass
class StageContext:
    """A stage's folder and its ways to write there so that a kill never costs finished work.

    `StageContext(folder)` is enough to call a stage by hand, for example in a test. A context may
    be pickled and sent to worker processes: `pending` and `atomic` work there; the metrics logger
    stays behind.
    """

    out: Path
    """Working folder; it is renamed when the stage is complete, so keep no path into it."""
    signature: str = ""
    """Signature of the output that is being made."""
    inputs_signatures: Mapping[str, str] = field(default_factory=dict)
    """Input name -> signature of the stage output it comes from."""
    metrics: str = "none"
    """Kind of metrics logger, see `metrics.open_metrics`."""
    metrics_folder: Path | None = None
    """Where metrics of all stages lie; they are a view of the work, never part of its output."""
    metrics_name: str = "stage"
    """This stage's name among them."""
    workers: WorkersConfig = field(default_factory=lambda: WorkersConfig(jobs=1))
    """Where `each` runs its shards; by default here, one after the other."""
    after_save: Callable[[], None] | None = None
    """Called after every completed `atomic`: the runner keeps the time spent so far."""
    shards: int = field(default=0, init=False)
    """How many shards `each` was given that could all run side by side, finished ones included."""
    _named: int = field(default=0, init=False, repr=False)
    _logger: Metrics | None = field(default=None, init=False, repr=False)

    def progress(
        self,
        iterable: Iterable[Any] | None = None,
        *,
        total: int | None = None,
        desc: str | None = None,
        initial: int = 0,
    ) -> tqdm:
        """A bar on a terminal, else a line every ten seconds at most; see `progress.progress`."""
        return progress(iterable, total=total, desc=desc, initial=initial)

    def pending(self, names: Sequence[str], suffix: str = "") -> list[str]:
        """The shards that are still to be made: those of `names` without a file `out/name+suffix`.

        Sound only for files written through `atomic`.

        Raises:
            ValueError: a name occurs twice, so one shard would overwrite another.
        """
        doubled = sorted(name for name, count in Counter(names).items() if count > 1)
        if doubled:
            raise ValueError(f"shard names must differ; these occur more than once: {doubled}")
        self._named = len(names)
        return [name for name in names if not (self.out / f"{name}{suffix}").exists()]

    def each(
        self, work: Callable[[StageContext, Any], None], shards: Sequence[Any], desc: str
    ) -> None:
        """Run `work(context, shard)` for every shard, on the workers; shows how many are done.

        `work` must be one that can be pickled: a function of a module, or a `functools.partial` of
        one. Its context is a copy of this one.
        """
        self.shards += max(self._named, len(shards))
        self._named = 0
        with self.progress(total=len(shards), desc=desc) as bar:
            work_here = partial(_call, work, self)
            for _ in each(work_here, shards, self.workers, self.after_save):
                bar.update()

    def table(
        self,
        file: str,
        work: Callable[[StageContext, str], pd.DataFrame],
        names: Sequence[str],
        desc: str,
    ) -> None:
        """Makes a table, `file`: the rows that `work(context, name)` returns, for every name.

        Each name is a shard. Its rows are kept in rows/NAME.csv as soon as they are made, so that
        interrupted work goes on after them, and join the table as they are written there.

        Raises:
            ValueError: a name occurs twice.
        """
        import pandas as pd  # takes half a second

        pending = self.pending([f"rows/{name}" for name in names], ".csv")
        self.each(partial(_keep_rows, work), [one.removeprefix("rows/") for one in pending], desc)
        with self.atomic(file) as path:
            rows = [
                pd.read_csv(self.out / "rows" / f"{name}.csv", dtype=str, keep_default_na=False)
                for name in names
            ]
            pd.concat(rows).to_csv(path, index=False)

    @contextmanager
    def atomic(self, path: str | Path) -> Iterator[Path]:
        """A temporary path to write to; it becomes `path`, whole, when the block ends well.

        `path` is relative to `out` or lies in it; see `durable.atomic` for files and folders.

        Raises:
            ValueError: `path` lies outside of `out`.
        """
        target = self.out / path
        if not target.resolve().is_relative_to(self.out.resolve()):
            raise ValueError(f"a stage writes into its own folder {self.out} only, not to {target}")
        with durable.atomic(target) as temporary:
            yield temporary
        if self.after_save is not None:
            self.after_save()

    @property
    def logger(self) -> Metrics:
        """The metrics logger, opened at first use. After a resumption it appends: steps between the
        last checkpoint and the interruption are there twice, the later one counts.
        """
        if self._logger is None:
            from .metrics import open_metrics  # torchrl takes seconds to import

            folder = self.metrics_folder or self.out / "metrics"
            self._logger = open_metrics(self.metrics, folder, self.metrics_name)
        return self._logger

    def close(self) -> None:
        """Closes the metrics logger, if it was opened."""
        if self._logger is not None:
            self._logger.close()
            self._logger = None

    def __getstate__(self) -> dict[str, Any]:
        """For worker processes: without the logger and the runner's clock."""
        return self.__dict__ | {"_logger": None, "after_save": None}


def _keep_rows(
    work: Callable[[StageContext, str], pd.DataFrame], context: StageContext, name: str
) -> None:
    rows = work(context, name)
    with context.atomic(f"rows/{name}.csv") as path:
        rows.to_csv(path, index=False)


def _call(work: Callable[[StageContext, Any], None], context: StageContext, shard: Any) -> None:
    try:
        with one_thread():
            work(context, shard)
    finally:
        context.close()
