"""Measured fields: points of a film (PointCloud), their values in a run (CloudView), FilmComponent."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from porocore.commands.calibration.interpolation import HistoryInterpolation
from porocore.core.fields import provided
from porocore.interfaces.sensitivities import MacroSensitivities
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.body.points import BodyPoints
from porocore.states import Array, IntArray

#: Places of the undeformed body, which are those of particles, or of the deformed one, which are those of a camera.
Place = Literal["reference", "deformed"]
#: Components of a field, as files have them; the last is the pressure.
COMPONENTS = ("u1", "u2", "u3", "p")
PRESSURE = COMPONENTS.index("p")
#: Parts of the place of a camera: its offset along x, y and z, and its rotation about them in degrees.
CAMERA_PARTS = ("x", "y", "z", "rx", "ry", "rz")
#: Angles below this [rad] have the series of their functions.
SMALL_ANGLE = 1e-4
#: So far outside the body, in reference coordinates of the nearest element, a point still counts, by extrapolation: the
#: surface moves with the unknowns, and places are rounded.
EDGE = 0.05


def rotation(vector: Array) -> Array:
    """Return the rotation (3, 3) about a vector [rad] by its length [Rodrigues]."""
    W, a, b, _ = _skew_parts(vector)
    return np.asarray(np.eye(3) + a * W + b * W @ W)


def rotation_slopes(vector: Array) -> Array:
    """Return the derivatives (3, 3, 3) of a rotation by the components of its vector [rad], which come first.

    ∂R/∂ω_k = [J e_k]× R with the left Jacobian J = I + (1 − cos θ)/θ² W + (θ − sin θ)/θ³ W² of the rotation group
    (Chirikjian, Stochastic Models, Information Theory, and Lie Groups 2, 2012, section 10.6).
    """
    W, _, b, c = _skew_parts(vector)
    J = np.eye(3) + b * W + c * W @ W
    R = rotation(vector)
    return np.stack([_skew(J[:, k]) @ R for k in range(3)])


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _skew_parts(vector: Array) -> tuple[Array, float, float, float]:
    """Return W with W x = ω × x, sin θ/θ, (1 − cos θ)/θ² and (θ − sin θ)/θ³."""
    angle = float(np.linalg.norm(vector))
    if angle < SMALL_ANGLE:
        return _skew(vector), 1 - angle**2 / 6, 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    return (
        _skew(vector),
        np.sin(angle) / angle,
        (1 - np.cos(angle)) / angle**2,
        (angle - np.sin(angle)) / angle**3,
    )


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Places and times at which a film has values.

    Attributes
    ----------
    name
        Of the observation in its experiment.
    places : (n, 3)
        Dimensionless, in the axes of the body as far as the place of the camera is known.
    times : (n,)
        Ascending, in the dimensionless times of the study.
    place
        Whether the places are of the undeformed or the deformed body.
    axes : (3, 3)
        By which the displacements in the axes of the camera become those in the axes of the body.
    outside
        Largest share of the points that may lie outside the body.
    origin : (3,)
        Place of the origin of the camera's axes, as far as it is known; None: that of the body.
    unknown
        Whether parts of the place of the camera are unknowns.
    """

    name: str
    places: Array
    times: Array
    place: Place = "reference"
    axes: Array | None = None
    outside: float = 1.0
    origin: Array | None = None
    unknown: bool = False

    def __len__(self) -> int:
        return len(self.times)

    @property
    def hindrance(self) -> str:
        """Reason for which points beyond a symmetry plane are no mirror images, in one word; empty: they are images."""
        return "unknown" if self.unknown else "turned" if self.axes is not None else ""

    @cached_property
    def identity(self) -> str:
        """Hash of all that the values in a run depend on."""
        parts = (self.places, self.times, np.eye(3) if self.axes is None else self.axes)
        content = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
        return hashlib.sha256(f"{self.name}|{self.place}|".encode() + content).hexdigest()

    @cached_property
    def frames(self) -> list[tuple[float, slice]]:
        """Distinct times, and the points at each."""
        times, first = np.unique(self.times, return_index=True)
        ends = [*first[1:].tolist(), len(self)]
        return [(float(t), slice(int(a), int(b))) for t, a, b in zip(times, first, ends, strict=True)]

    @cached_property
    def middle(self) -> Array:
        """Middle (3,) of the places, about which an unknown rotation turns them."""
        return np.asarray(self.places.mean(axis=0))

    def camera_place(self, camera: Array) -> tuple[Array, Array]:
        """Return the whole place of the camera in the body: the origin of its axes (3,), and a rotation vector (3,).

        Places in the axes of the camera become those in the body by x = offset + R x', R the rotation by the vector in
        degrees, and displacements by u = R u'.

        Parameters
        ----------
        camera : (6,)
            Its unknown parts; see :meth:`moved`.
        """
        R = rotation(np.deg2rad(camera[3:]))
        origin = np.zeros(3) if self.origin is None else self.origin
        offset = R @ (origin - self.middle) + self.middle + camera[:3]
        whole = R if self.axes is None else R @ self.axes
        return offset, np.asarray(Rotation.from_matrix(whole).as_rotvec(degrees=True))

    def kept(self, rows: Any) -> PointCloud:
        """Return the cloud of some points alone; the middle stays where it is only by chance."""
        return replace(self, places=self.places[rows], times=self.times[rows])

    def moved(self, camera: Array) -> Array:
        """Return the places (n, 3) with the unknown parts (6,) of the camera's place: lengths, then degrees."""
        if not camera.any():
            return self.places
        R = rotation(np.deg2rad(camera[3:]))
        return np.asarray((self.places - self.middle) @ R.T + self.middle + camera[:3])


@dataclass(frozen=True, eq=False)
class CloudFrame:
    """Points of a cloud at one time, and the fields of the run there.

    Attributes
    ----------
    points
        In the elements.
    u : (nodes, 3)
        Displacement of the nodes at the time.
    p : (p_nodes,)
        Pressure of the corners.
    rate : (unknowns,)
        Derivative of all nodal values by the time.
    """

    points: BodyPoints
    u: Array
    p: Array
    rate: Array


class CloudView:
    """Values of a cloud in one run, with their derivatives.

    A place of the undeformed body has the values of its particle. One of the deformed body has those of the particle
    that has come there: x = X + u(X) is solved for X by its element, and since x stays where it is, the values change
    by ∂u/∂θ − (∂u/∂x) ∂u/∂θ and ∂p/∂θ − (∂p/∂x) · ∂u/∂θ, with derivatives by θ at X on the right.

    Parameters
    ----------
    cloud
        The points.
    solution
        Of the run, with profiles at all times between which values are interpolated.
    to_study
        Factor from times of the run to those of the study.
    shift
        Added to the times of the points, in those of the study.
    camera : (6,)
        Unknown parts of its place; see :meth:`PointCloud.moved`.
    near
        Points of another view of the cloud, by frames, in whose elements places are looked for first.
    """

    def __init__(
        self,
        cloud: PointCloud,
        solution: MacroSolution,
        to_study: float,
        shift: float,
        camera: Array,
        near: list[BodyPoints] | None = None,
    ) -> None:
        self.cloud, self._camera = cloud, camera
        mesh = BodyMesh.of(solution)
        profiles = solution.profiles
        self._frames, steps = cloud.frames, np.array([each.time for each in profiles]) * to_study
        self._at = HistoryInterpolation.at(steps, np.array([time for time, _ in cloud.frames]) + shift)
        self._count, self._size = len(profiles), mesh.size
        places = cloud.moved(camera)
        self.frames: list[CloudFrame] = []
        fixed: dict[bytes, BodyPoints] = {}
        for k, (_, part) in enumerate(self._frames):
            before, share, rate = (
                int(self._at.before[k]), float(self._at.share[k]), float(self._at.rate[k]),
            )  # fmt: skip
            one, two = profiles[before], profiles[before + 1]
            u, p = (1 - share) * one.u + share * two.u, (1 - share) * one.p + share * two.p
            here = places[part]
            known = None if near is None or len(near[k]) != len(here) else near[k]
            if cloud.place == "deformed":
                last = self.frames[-1].points if self.frames else None
                known = known or (last if last is not None and len(last) == len(here) else None)
                points = BodyPoints.at(mesh, here, mesh.points + u, known)
            else:
                key = here.tobytes()
                points = fixed[key] = fixed.get(key) or BodyPoints.at(mesh, here, near=known)
            moving = np.concatenate([(two.u - one.u).ravel(), (two.p - one.p)[mesh.p_nodes]])
            self.frames.append(CloudFrame(points, u, p[mesh.p_nodes], rate * moving))
        self._rows: dict[tuple[int, int], Any] = {}

    @cached_property
    def _turn(self) -> Array:
        """Rotation (3, 3) from displacements in the axes of the camera to those in the axes of the body."""
        R = rotation(np.deg2rad(self._camera[3:]))
        return R if self.cloud.axes is None else R @ self.cloud.axes

    @property
    def points(self) -> list[BodyPoints]:
        """Points of each frame."""
        return [frame.points for frame in self.frames]

    @property
    def counting(self) -> npt.NDArray[np.bool_]:
        """(n,) which points lie in the body, or hardly outside it."""
        return np.concatenate([frame.points.beyond for frame in self.frames]) <= EDGE

    def values(self, component: int) -> Array:
        """Return the values (n,) of a component, in the axes of the camera."""
        return np.concatenate([self._value(frame, component) for frame in self.frames])

    def _value(self, frame: CloudFrame, component: int) -> Array:
        if component == PRESSURE:
            return frame.points.pressure(frame.p)
        return np.asarray(frame.points.displacement(frame.u) @ self._turn[:, component])

    def rows(self, frame: int, component: int) -> Any:
        """Return the sparse derivatives (points of the frame, unknowns) of a component by all nodal values."""
        at = self.frames[frame]
        deformed = self.cloud.place == "deformed"
        # The points of many frames are the same ones in the undeformed body.
        key = (frame, component) if deformed else (id(at.points), component)
        if key not in self._rows:
            n = len(at.points)
            if component == PRESSURE:
                of_u = -at.points.pressure_gradient(at.p) if deformed else None
                self._rows[key] = at.points.rows(of_u, np.ones(n))
            else:
                of_u = np.broadcast_to(self._turn[:, component], (n, 3))
                if deformed:
                    of_u = of_u - np.einsum("nij,i->nj", at.points.displacement_gradient(at.u), of_u[0])
                self._rows[key] = at.points.rows(of_u)
        return self._rows[key]

    def rates(self, component: int) -> Array:
        """Return the derivatives (n,) of a component by the time."""
        parts = [self.rows(k, component) @ each.rate for k, each in enumerate(self.frames)]
        return np.asarray(np.concatenate(parts))

    def slopes(self, component: int, found: MacroSensitivities) -> Array:
        """Return the derivatives (n, k) of a component by the unknowns of the run."""
        fields, parts = provided(found.profiles), []
        for k in range(len(self.frames)):
            before, share = int(self._at.before[k]), float(self._at.share[k])
            moved = (1 - share) * fields[before] if share < 1 else 0.0
            moved = moved + share * fields[before + 1] if share > 0 else moved
            parts.append(self.rows(k, component) @ moved)
        return np.concatenate(parts)

    def weights(self, component: int, given: Array) -> Array:
        """Return the weights (profiles, unknowns, f) of the nodal fields in f sums over a component.

        Parameters
        ----------
        component
            Which.
        given : (n, f)
            Weights of its values.
        """
        found = np.zeros((self._count, self._size, given.shape[1]))
        for k, (_, part) in enumerate(self._frames):
            before, share = int(self._at.before[k]), float(self._at.share[k])
            here = self.rows(k, component).T @ given[part]
            found[before] += (1 - share) * here
            found[before + 1] += share * here
        return found

    def by_camera(self, component: int) -> Array:
        """Return the derivatives (n, 6) of a component by the parts of the camera's place: lengths, then degrees."""
        R, slopes = rotation(np.deg2rad(self._camera[3:])), rotation_slopes(np.deg2rad(self._camera[3:]))
        arms = self.cloud.places - self.cloud.middle
        moves = np.einsum("kij,nj->nik", slopes, arms)
        of_place, parts = np.concatenate([np.broadcast_to(np.eye(3), moves.shape), moves], axis=2), []
        axes = np.eye(3) if self.cloud.axes is None else self.cloud.axes
        for frame, (_, part) in zip(self.frames, self._frames, strict=True):
            if component == PRESSURE:
                gradient: Array = frame.points.pressure_gradient(frame.p)
                parts.append(np.einsum("nj,njk->nk", gradient, of_place[part]))
                continue
            gradient = frame.points.displacement_gradient(frame.u)
            direction = R @ axes[:, component]
            by = np.einsum("i,nij,njk->nk", direction, gradient, of_place[part], optimize=True)
            turned = np.einsum("kij,j->ik", slopes, axes[:, component])
            by[:, 3:] += frame.points.displacement(frame.u) @ turned
            parts.append(by)
        found: Array = np.concatenate(parts)
        found[:, 3:] *= np.pi / 180
        return found


@dataclass(frozen=True, eq=False)
class FilmComponent:
    """A component of the fields of a run at the points of a cloud.

    Attributes
    ----------
    cloud
        The points.
    component
        Of :data:`COMPONENTS`, from 0.
    picked : (m,)
        Points at which it was measured; None: all.
    """

    cloud: PointCloud
    component: int
    picked: IntArray | None = None

    def __repr__(self) -> str:
        picked = b"" if self.picked is None else self.picked.tobytes()
        return f"FilmComponent({self.cloud.identity}, {self.component}, {hashlib.sha256(picked).hexdigest()})"

    @property
    def quantity(self) -> str:
        """Quantity of the values, of :data:`porocore.core.units.QUANTITIES`."""
        return "pressure" if self.component == PRESSURE else "displacement"

    @property
    def words(self) -> str:
        """Quantity and places, in words."""
        what = "pressure" if self.component == PRESSURE else f"displacement {self.component + 1}"
        return f"{what} at {len(self)} points and times of the {'un' * self.is_reference}deformed body"

    @property
    def is_reference(self) -> bool:
        """True where the places are of the undeformed body."""
        return self.cloud.place == "reference"

    def __len__(self) -> int:
        return len(self.cloud) if self.picked is None else len(self.picked)

    def of_points(self, values: Array) -> Array:
        """Return the values of the points at which it was measured, (m, ...), of those (n, ...) of all."""
        return values if self.picked is None else values[self.picked]

    def without(
        self, cloud: PointCloud, kept: npt.NDArray[np.bool_]
    ) -> tuple[FilmComponent, npt.NDArray[np.bool_]]:
        """Return the component at the points of a smaller cloud, and which of its values (m,) are left.

        Parameters
        ----------
        cloud
            The points that are kept.
        kept : (n,)
            Which they are of those of the present cloud.
        """
        rows = np.arange(len(kept)) if self.picked is None else self.picked
        left = kept[rows]
        places = (np.cumsum(kept) - 1)[rows[left]]
        return FilmComponent(cloud, self.component, None if len(places) == len(cloud) else places), left

    def to_points(self, given: Array) -> Array:
        """Return weights (n, f) of all points from those (m, f) of the points at which it was measured."""
        if self.picked is None:
            return given
        found = np.zeros((len(self.cloud), given.shape[1]))
        found[self.picked] = given
        return found

    @property
    def places(self) -> Array:
        """Places (m, 3) at which it was measured."""
        return self.of_points(self.cloud.places)


class CloudViews(Mapping[str, CloudView]):
    """Views of the clouds of one experiment in a run, by the names of the clouds, each made when it is asked for.

    Parameters
    ----------
    clouds
        By their names.
    solution
        Of the run.
    to_study
        Factor from times of the run to those of the study.
    shift
        Added to the times of the data, in those of the study.
    cameras
        Unknown parts (6,) of the places of cameras, by the names of the clouds.
    near
        Points of earlier views; see :class:`CloudView`. It is renewed.
    """

    def __init__(
        self,
        clouds: Mapping[str, PointCloud],
        solution: MacroSolution,
        to_study: float,
        shift: float,
        cameras: Mapping[str, Array],
        near: dict[str, list[BodyPoints]],
    ) -> None:
        self._clouds, self._made = clouds, dict[str, CloudView]()
        self._solution, self._to_study, self._shift, self._cameras = solution, to_study, shift, cameras
        self._near = near

    def __getitem__(self, name: str) -> CloudView:
        if name not in self._made:
            cloud = self._clouds[name]
            camera, near = self._cameras.get(name, np.zeros(6)), self._near.get(name)
            view = CloudView(cloud, self._solution, self._to_study, self._shift, camera, near)
            self._made[name], self._near[name] = view, view.points
        return self._made[name]

    def __iter__(self) -> Any:
        return iter(self._clouds)

    def __len__(self) -> int:
        return len(self._clouds)
