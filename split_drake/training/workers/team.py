"""The processes that train beside the one that was started, from their start to their end."""

import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import torch
from torch import multiprocessing

from split_drake.training.losses import Losses
from split_drake.training.memory import keep_freed_memory
from split_drake.training.trainer import Trainer, TrainingDivergedError
from split_drake.training.workers.peers import PeerLostError, joined

# What a process is given to end by itself before it is ended.
_GRACE_S = 5.0
_CONTEXT = multiprocessing.get_context("spawn")

TakeStep = Callable[[float], Losses]


def require_divisible(scenes: int, count: int, device: torch.device) -> None:
    """Exit where a batch of so many scenes cannot be divided among `count` processes."""
    if count < 1 or scenes % count:
        raise SystemExit(
            f"--workers is {count}; expected a divisor of --batch.scenes, which is {scenes}"
        )
    if count > 1 and device.type != "cpu":
        raise SystemExit(f"--workers is {count}; on {device.type} only one process can train")


@dataclass(frozen=True)
class _Job:
    """What a worker is to know.

    Attributes:
        make_trainer: makes the same trainer in all processes; its scenes are in shared memory.
        count: of the processes, with the one that was started.
        threads: of each.
        matmul_precision: PyTorch's, of float32.
        folder: in which the trainer's state is, and where the processes meet.
    """

    make_trainer: Callable[[], Trainer]
    count: int
    threads: int
    matmul_precision: str
    folder: Path

    @property
    def state(self) -> Path:
        """What all trainers start from."""
        return self.folder / "state.pt"

    @property
    def meeting(self) -> Path:
        """Where the processes find one another."""
        return self.folder / "meeting"


def _work(job: _Job, rank: int, orders: Connection) -> None:
    """Take part in each step that is ordered, until there will be no more orders."""
    # Ctrl-C goes to all processes of a terminal: the first one alone decides when to stop.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(job.threads)
    torch.set_float32_matmul_precision(job.matmul_precision)
    keep_freed_memory()
    trainer = job.make_trainer()
    trainer.restore(job.state)
    orders.send(rank)
    # The first process tells what happened: it is also the one that orders end with.
    with (
        suppress(EOFError, ConnectionError, PeerLostError, TrainingDivergedError),
        joined(rank, job.count, job.meeting) as trainer.peers,
    ):
        orders.send(rank)
        while True:
            trainer.take_step(orders.recv())


class _Worker:
    """A process that takes part in the steps that it is told of."""

    def __init__(self, job: _Job, rank: int) -> None:
        self.rank = rank
        self._orders, theirs = _CONTEXT.Pipe()
        self._process = _CONTEXT.Process(target=_work, args=(job, rank, theirs), daemon=True)
        self._process.start()
        theirs.close()  # so that its end closes the pipe

    def wait(self) -> None:
        """Return once the worker has its trainer, and again once it has met the others.

        Raises EOFError where it ended before.
        """
        self._orders.recv()

    def order(self, progress: float) -> None:
        """Have it take part in a step; raise ConnectionError where it has ended."""
        self._orders.send(progress)

    def dismiss(self) -> None:
        """Tell it that there will be no more orders."""
        self._orders.close()

    def end(self) -> None:
        """Wait for its end, which is at once where it does not come by itself."""
        self._process.join(_GRACE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def death(self) -> str | None:
        """Return how the worker failed; None where it did not."""
        self._process.join(_GRACE_S)
        code = self._process.exitcode
        if not code:
            return None
        how = f"was killed by signal {-code}" if code < 0 else f"failed with exit code {code}"
        return f"worker {self.rank} {how}"


@contextmanager
def team(make_trainer: Callable[[], Trainer], trainer: Trainer, count: int) -> Iterator[TakeStep]:
    """Yield what takes a step of `trainer`, together with `count` - 1 more processes.

    They start from the state of `trainer`, and share the cores that PyTorch uses.

    Args:
        make_trainer: what made `trainer`; it is called in each process.
        trainer: of this process, which alone reports and saves.
        count: of processes, this one among them; with 1 there is none beside it.

    SystemExit says what became of a worker that ended before it was told to.
    """
    if count == 1:
        yield trainer.take_step
        return
    with ExitStack() as stack:
        threads = stack.enter_context(_share_of_threads(count))
        workers = list[_Worker]()
        stack.callback(_end_all, workers)
        # The folder is gone once all have met: a process that is killed later leaves nothing.
        with tempfile.TemporaryDirectory() as folder, _telling_of_losses(trainer, workers):
            precision = torch.get_float32_matmul_precision()
            job = _Job(make_trainer, count, threads, precision, Path(folder))
            trainer.save(job.state)
            with _no_ctrl_c():
                workers.extend(_Worker(job, rank) for rank in range(1, count))
            for worker in workers:
                worker.wait()
            trainer.peers = stack.enter_context(joined(0, count, job.meeting))
            for worker in workers:
                worker.wait()
        stack.callback(setattr, trainer, "peers", None)
        yield partial(_take_step, trainer, workers)


def _take_step(trainer: Trainer, workers: Sequence[_Worker], progress: float) -> Losses:
    """Have all take a step."""
    with _telling_of_losses(trainer, workers):
        for worker in workers:
            worker.order(progress)
        return trainer.take_step(progress)


def _end_all(workers: Sequence[_Worker]) -> None:
    """Have all workers come to their end."""
    for worker in workers:
        worker.dismiss()
    for worker in workers:
        worker.end()


@contextmanager
def _share_of_threads(count: int) -> Iterator[int]:
    """Leave this process one of `count` equal shares of PyTorch's threads; yield how many."""
    before = torch.get_num_threads()
    threads = max(1, before // count)
    torch.set_num_threads(threads)
    try:
        yield threads
    finally:
        torch.set_num_threads(before)


@contextmanager
def _no_ctrl_c() -> Iterator[None]:
    """Have processes that are started now deaf to Ctrl-C from their first moment."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _telling_of_losses(trainer: Trainer, workers: Sequence[_Worker]) -> Iterator[None]:
    """Exit with a sentence where a worker was lost."""
    try:
        yield
    except (EOFError, ConnectionError, PeerLostError) as error:
        deaths = [death for worker in workers if (death := worker.death())]
        raise SystemExit(
            f"{'; '.join(deaths) or f'the workers were lost ({error})'} after step {trainer.step}; "
            "--resume goes on from what was saved last"
        ) from error
