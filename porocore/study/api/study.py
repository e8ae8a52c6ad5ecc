"""A whole study from Python (Study): check, sample, train, tune, solve, law, sweep, report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.core.parallel.memory import one_blas_thread
from porocore.core.units import ResultUnits
from porocore.errors import ConfigurationError
from porocore.interfaces.command import Command
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws.macro_law import Law
from porocore.plugins.registry import find_command, make_command
from porocore.sampling.datasets.dataset import Dataset
from porocore.study.api.solved import (
    LawsSolved,
    Samples,
    Solutions,
    Solved,
    configured,
    of_named_cell,
    values_over,
)
from porocore.study.config.config import RunConfig
from porocore.study.config.errors import located
from porocore.study.config.loading import command_of_section, section_settings
from porocore.study.notes.at_rest import at_rest
from porocore.study.notes.checks import check_backends, check_section
from porocore.study.notes.outline import outline
from porocore.study.run import pipeline
from porocore.study.run.composition import USUAL_LAWS, LawKind, law_of_cell, porosity_of, require_laws
from porocore.study.run.folder import RunFolder
from porocore.study.run.results import load_reference, load_solution, load_surrogate
from porocore.study.store import chosen_store
from porocore.study.sweep.plan import SweepPlan
from porocore.study.sweep.results import ParameterSweep
from porocore.study.sweep.run import require_sweep_laws, run_sweep
from porocore.study.tuning import DEPTHS, WIDTHS, Tuning, candidates, tune


class Study:
    """A configuration and the folder of its results.

    Every stage runs the missing stages before it, continues where an earlier process stopped, and repeats nothing that
    the folder holds. The command line and this class may take turns.

    Parameters
    ----------
    source
        A configuration file, the name of an example that comes with porocore (``porocore init`` lists them), settings
        nested as in a file, or a configuration that was loaded before.
    out
        The run folder; by default ``runs/NAME`` with the name of the file or example.
    progress
        Show progress on standard error.
    store
        Folder of results that studies share; True: that of the user (``POROCORE_STORE``, or the cache folder), False:
        none. What it holds is not computed again.
    **settings
        Sections that are merged into the source, such as ``macro={"loads": [-0.1]}``.

    Raises
    ------
    ConfigurationError
        As :func:`porocore.load_config`; or a wrong surface, boundary condition or probe.
    PluginError
        A backend is missing.

    Examples
    --------
    >>> from porocore import Study
    >>> study = Study("cartilage-confined", macro={"loads": [-0.05]}, out="plug", progress=False)
    >>> study.config.closure, study.config.macro.loads
    ('potential', (-0.05,))
    >>> study.check()[0]
    'Confined compression of a cartilage plug'

    Every stage is a method, such as ``study.solve()[-0.05]["surrogate"].settlement``.
    """

    def __init__(
        self,
        source: str | Path | Mapping[str, Any] | RunConfig | None = None,
        *,
        out: str | Path | None = None,
        progress: bool = True,
        store: str | Path | bool = True,
        **settings: Any,
    ) -> None:
        if out is not None and not isinstance(out, str | Path):
            raise ConfigurationError(f"out: expected the path of a folder, got {echo(out)}")
        name, self.config, self._document = configured(source, settings)
        self.path = Path("runs") / name if out is None else Path(out)
        self._console = Console.shown(progress)
        self._store = chosen_store(store)

    def __repr__(self) -> str:
        return f"<porocore study '{self.config.title}' in {self.path}>"

    @cached_property
    def folder(self) -> RunFolder:
        """The run folder, made or resumed at its first use.

        Raises
        ------
        RunFolderError
            It holds another run, or cannot be written.
        """
        with located(self._document):
            check_backends(self.config)
        return RunFolder.claim(self.path, self.config, resume=True)

    @property
    def _trained(self) -> bool:
        """True if the surrogates of all cells are there."""
        return all(files.surrogate.exists() for files in self.folder.of_each_cell)

    @contextmanager
    def _at_work(self) -> Iterator[RunFolder]:
        """Hold the run folder, and compute on one thread."""
        with one_blas_thread(), self.folder as folder:
            yield folder

    @property
    def units(self) -> ResultUnits:
        """Units of the study; ``units.factor("stress")`` takes dimensionless stresses to ``output_units``."""
        return self.config.result_units

    def check(self) -> list[str]:
        """Check the study, and return an outline of its run, line by line; only the undeformed cell is solved.

        Sections of commands such as ``calibration:`` are checked, and their data are read.
        """
        with located(self._document):
            check_backends(self.config)
            found = check_section(self._document, self.config)
            return [*outline(self.config), *at_rest(self.config), *(found[1].lines if found else ())]

    def section(self, name: str) -> Any:
        """Return a section of an installed command, such as ``calibration``, as its model has it.

        Its values are dimensionless, as all of the study are.
        """
        with located(self._document):
            offered = command_of_section(name)
            model = None if offered is None else make_command(offered).section()
            if model is None:
                raise ConfigurationError(
                    f"{name}: no installed plugin has a command with this section; 'porocore plugins' lists all"
                )
            return section_settings(self._document, name, model, self.config.scales)

    if not TYPE_CHECKING:  # else a misspelt name would have a type

        def __getattr__(self, name: str) -> Callable[..., Any]:
            offered = None if name.startswith("_") else find_command(lambda offer: offer.key == name)
            command = None if offered is None else make_command(offered)
            if command is None or type(command).call is Command.call:
                raise AttributeError(
                    f"a study has no '{name}', and no installed command of this name is for Python"
                )
            return partial(command.call, self)

    def sample(self, *, retry_lost: bool = False, cell: str | None = None) -> Samples:
        """Solve the cells for the sampled and the held-out states; return the sampled ones.

        Of several ``cells`` those of the named ``cell`` are returned, by default of that of the rest of the body.
        """
        one = of_named_cell(self.config, cell)
        with self._at_work() as folder, located(self._document):
            pipeline.solve_reference(folder, console=self._console, store=self._store)
            pipeline.sample(folder, console=self._console, retry_lost=retry_lost, store=self._store)
        dataset = Dataset.open(folder.of_cell(cell).dataset, identity=one.stages.sampling)
        return Samples(tuple(one.sampling.inputs), dataset.x(), dataset.states(), dataset.responses())

    def train(self, *, cell: str | None = None) -> Surrogate:
        """Train the surrogate on the sampled states; its ``predict`` takes a :class:`porocore.MacroState`.

        Of several ``cells`` that of the named ``cell`` is returned, by default that of the rest of the body.
        """
        of_named_cell(self.config, cell)
        if not self._trained:
            self.sample()
        with self._at_work() as folder:
            pipeline.train(folder, console=self._console, store=self._store)
        return load_surrogate(folder.of_cell(cell))

    def tune(
        self,
        *,
        depths: Sequence[int] = DEPTHS,
        widths: Sequence[int] = WIDTHS,
        activations: Sequence[str] | None = None,
        margin: float = 0.1,
        workers: int | None = None,
    ) -> Tuning:
        """Train networks of several sizes and choose the smallest that is about as good as the best.

        Parameters
        ----------
        depths, widths
            Numbers of hidden layers, and their widths.
        activations
            Activations; by default all that the model has.
        margin
            Share by which the error of the chosen network may exceed that of the best.
        workers
            Processes; by default as configured for sampling.
        """
        grid = candidates(self.config, depths, widths, activations)
        self.sample()
        with self._at_work() as folder:
            return tune(
                folder,
                self.config,
                grid,
                console=self._console,
                margin=margin,
                workers=workers,
                store=self._store,
            )

    def solve(self, laws: Sequence[LawKind] = USUAL_LAWS) -> Solutions:
        """Solve the macroscopic problem under every load with each of ``laws``.

        Parameters
        ----------
        laws
            Some of surrogate, linear, direct (the cell itself at every point) and fallback.

        Returns
        -------
        Solutions
            Solutions by load, then by law.
        """
        require_laws(laws)
        if not self._trained:
            self.train()
        with self._at_work() as folder:
            names = pipeline.solve(folder, console=self._console, laws=laws, store=self._store)
        return Solutions(
            {
                load: LawsSolved({law: Solved(load_solution(folder, law, load), self.units) for law in names})
                for load in self.config.macro.loads
            }
        )

    def law(self, kind: Literal["surrogate", "linear"] = "surrogate", *, cell: str | None = None) -> Law:
        """Return the macroscopic law of the study as a function of the state, for a solver of one's own.

        Parameters
        ----------
        kind
            ``surrogate``: the trained surrogate with the closure of the configuration; ``linear``: linear
            poroelasticity of the same cell.
        cell
            Name of one of several ``cells``; None: that of the rest of the body, or the only one.

        Examples
        --------
        ``study.law().response(grad_u, p)`` has stress, fluid volume, conductivity, flag, and exact derivatives by
        (H, p) of n states; see :class:`porocore.Law`. That of a family of cells takes its ``parameters`` with the
        states, or they are bound: ``study.law().at(radius=0.22)``.
        """
        if kind not in ("surrogate", "linear"):
            raise ConfigurationError(
                f"kind: expected 'surrogate' or 'linear', got {echo(kind)}; porocore.CellProblem solves the cell itself"
            )
        one = of_named_cell(self.config, cell)
        # Linear poroelasticity of a family is its surrogate's, at rest.
        learned = kind == "surrogate" or one.cell.is_family
        if learned and not self._trained:
            self.train()
        with self._at_work() as folder, ExitStack() as stack:
            files = folder.of_cell(cell)
            if not files.reference.exists():
                pipeline.solve_reference(folder, console=self._console, store=self._store)
            run = law_of_cell(files, stack, kind)
            porosity = porosity_of(run.law, load_reference(files))
            return Law(run.law, porosity, self.units, one.cell.parameters)

    def sweep(
        self,
        parameter: str | Mapping[str, Sequence[float]],
        values: Sequence[float] | None = None,
        *,
        laws: Sequence[LawKind] = USUAL_LAWS,
        out: str | Path | None = None,
    ) -> ParameterSweep:
        """Solve the body for each value of a parameter of its cell; the cells are solved and learned once.

        A number of the cell becomes a range between the ends of its values. The run folder gets ``sweep.csv``,
        ``sweep.png`` and ``sweep.svg``; values that it holds are not solved again.

        Parameters
        ----------
        parameter, values
            Name of a number of the cell, such as ``radius``, and its values; or values of one or two by name.
        laws
            Surrogate, and linear beside it.
        out
            Run folder of the family; by default that of the study where this is its study already, else one beside it.
        """
        require_sweep_laws(laws)
        plan = SweepPlan.over(self.config, values_over(parameter, values))
        beside = self.path if plan.family is self.config else Path(f"{self.path}{plan.suffix}")
        with located(self._document):
            check_backends(plan.family)
            folder = RunFolder.claim(beside if out is None else out, plan.family, resume=True)
            with one_blas_thread(), folder:
                return run_sweep(folder, plan, console=self._console, laws=laws, store=self._store)

    def report(self, laws: Sequence[LawKind] = USUAL_LAWS) -> Path:
        """Write the report, and return the path of the page.

        Parameters
        ----------
        laws
            As for :meth:`solve`, the surrogate among them; without ``linear`` nothing is compared with it.
        """
        require_laws(laws)
        if "surrogate" not in laws:
            raise ConfigurationError(
                f"laws: expected 'surrogate' among them, which a report shows, got {laws}"
            )
        self.solve(laws)
        with self._at_work() as folder:
            return pipeline.report(folder, console=self._console)
