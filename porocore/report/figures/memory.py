"""Figures of what a law remembers: a field of the body over the kept times, and along a column."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from porocore.core.units import units_now
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.report.figures import style
from porocore.report.figures.curves import ProfileField
from porocore.report.figures.style import axis_label, legend_above, new_figure, styled
from porocore.report.words.memory import BodyMemory, Course
from porocore.report.words.parameters import volumes_of
from porocore.states import Array


@styled
def course_figure(memory: BodyMemory, course: Course) -> Figure:
    """Draw the mean of a field over the body against time, with the band from its least to its largest value."""
    figure, units = new_figure(5.4, 3.6), units_now()
    axes = figure.add_subplot()
    factor, time = units.factor(course.quantity), memory.times * units.factor("time")
    volumes = np.where(np.isfinite(course.values[0]), volumes_of(memory.solution), 0.0)
    mean = np.nan_to_num(course.values) @ volumes / volumes.sum() * factor
    low, high = (end(course.values, axis=1) * factor for end in (np.nanmin, np.nanmax))
    axes.fill_between(time, low, high, color=style.lighter(style.BLUE), lw=0, label="least to largest")
    axes.plot(time, mean, color=style.BLUE, marker="o", ms=4, label="mean over the body")
    axes.set_xlabel(axis_label("time $t$", "time"))
    axes.set_ylabel(axis_label(course.label, course.quantity))
    axes.margins(x=0.02)
    legend_above(figure, axes, columns=2)
    return figure


def profile_field(solution: MacroSolution, course: Course) -> ProfileField:
    """Return a field of :class:`~porocore.report.words.memory.BodyMemory` as one that is drawn along a column."""
    number = {id(profile): i for i, profile in enumerate(solution.profiles)}

    def take(profile: Profile) -> Array:
        return np.asarray(course.values[number[id(profile)]])

    return ProfileField(course.label, course.plain, take, course.quantity)
