"""Selection of the backends that take part in a crosscheck."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from porocore.errors import PluginError
from porocore.verification.backends import FEM, advice, find_backends
from porocore.verification.crosscheck.comparison import Comparison


@dataclass(frozen=True)
class BackendSelection:
    """Names of the backends of each kind.

    Attributes
    ----------
    cells, bodies, surrogates
        That can be loaded, as far as can be told without loading them.
    broken
        One failure for each plugin that is installed and cannot be used.
    absent
        Installed plugins whose requirements are not, with what installs those.
    """

    cells: tuple[str, ...]
    bodies: tuple[str, ...]
    surrogates: tuple[str, ...]
    broken: tuple[Comparison, ...] = ()
    absent: tuple[str, ...] = ()


def select_backends(fem: Sequence[str] = (), surrogates: Sequence[str] = ()) -> BackendSelection:
    """Return the installed backends, or those that are named.

    A backend whose requirements are not installed stays out; a plugin that is broken is a failure, unless
    both kinds are named.

    Raises
    ------
    PluginError
        A name is unknown or cannot be used; or there are not two of any kind, so that nothing can be compared.
    """
    found = find_backends({FEM: fem, ("surrogate",): surrogates})
    broken = (
        Comparison.failure(
            "plugin", row.kind, row.name, row.distribution, f"{row.distribution} is {row.state}: {row.advice}"
        )
        for row in found.broken
    )
    chosen = BackendSelection(
        found.names["cell solver"],
        found.names["macro solver"],
        found.names["surrogate"],
        () if fem and surrogates else tuple(dict.fromkeys(broken)),
        () if fem or surrogates else found.absent,
    )
    if not chosen.cells:
        why = advice(row for row in (*found.broken, *found.missing) if row.kind in ("cell solver", ""))
        raise PluginError(
            "there is nothing to compare: no cell solver takes part; install one: "
            + ("; ".join(why) or "see docs/plugins.md")
        )
    if not chosen.broken and max(map(len, (chosen.cells, chosen.bodies, chosen.surrogates))) < 2:
        named = [*dict.fromkeys((*chosen.cells, *chosen.bodies)), *chosen.surrogates]
        more = "; ".join(advice(found.missing))
        if fem or surrogates:
            more = "leave out --fem and --surrogate, or repeat them"
        raise PluginError(
            "there is nothing to compare: a crosscheck needs two finite-element backends or two surrogates, and "
            f"there is only {' and '.join(named) or 'none'}; {more or 'install another (docs/plugins.md)'}"
        )
    return chosen
