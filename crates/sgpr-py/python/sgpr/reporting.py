"""Pages with plots of what Python holds."""

import os

from ._pages import write_page
from ._sgpr import Excitation, Robot, SgprError, Simulation


def save_report(result: Excitation | Simulation, robot: Robot, path: str | os.PathLike[str]) -> None:
    """Writes a page with plots, complete or not there.

    Of a motion that was found: position, speed and acceleration, the largest values, what it reveals, and the criterion
    over the evaluations. Of a simulated experiment: wanted positions, tracking error, torque and friction.

    Parameters
    ----------
    result : Excitation or Simulation
    robot : Robot
        The arm of the result.
    path : path
        Of the HTML file, which needs no other.

    Examples
    --------
    >>> robot = sgpr.robots.two_link()
    >>> found = sgpr.excite(robot, terms=3, max_acceleration=[2, 2], starts=1, max_evaluations=50)
    >>> sgpr.save_report(found, robot, "motion.html")
    >>> sgpr.save_report(sgpr.simulate(robot, found.trajectory), robot, "tracking.html")
    """
    # Not needed by those who draw nothing.
    from .report.motion import MotionPage
    from .report.tracking import TrackingPage
    from .report.versions import versions

    if not isinstance(result, Excitation | Simulation):
        raise TypeError(
            f"result: got {type(result).__name__}, expected Excitation or Simulation; models and diagnoses have "
            "a page of their own: `model.save_report`, `diagnosis.report`"
        )
    names = result.trajectory.joint_names if isinstance(result, Excitation) else result.joint_names
    if names != robot.joint_names:
        raise SgprError(f"robot: its joints are {', '.join(robot.joint_names)}, those of the result {', '.join(names)}")
    if isinstance(result, Excitation):
        text = MotionPage(robot, result, {"versions": versions()}).html()
    else:
        text = TrackingPage(robot, result, {}, versions()).html()
    write_page(path, text)
