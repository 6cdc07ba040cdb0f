"""The logs that come with the toolkit."""

from __future__ import annotations

from ..errors import unknown_name
from ..robots.library.folders import built_in_names, robot_folder
from ..robots.library.load import load_robot
from .log import LogSet
from .reading import read_logs


def demo_logs(robot: str = "puma560") -> tuple[LogSet, LogSet]:
    """Logs of a built-in robot: one to fit, one to validate on.

    Parameters
    ----------
    robot : str
        A built-in robot that has logs.

    Returns
    -------
    fit, held : LogSet
        Simulated in closed loop with sensor noise; position on the motor side (rad), torque on the motor side (N m).

    Raises
    ------
    ConfigurationError
        A robot without logs.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> train.n, len(train)
    (6, 1)
    """
    with_logs = [name for name in built_in_names() if (robot_folder(name) / "demo/train.csv.gz").is_file()]
    if robot not in with_logs:
        raise unknown_name("robot with logs", robot, with_logs)
    folder, arm = robot_folder(robot) / "demo", load_robot(robot)
    return read_logs(folder / "train.csv.gz", arm), read_logs(folder / "validate.csv.gz", arm)
