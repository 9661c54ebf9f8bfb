"""What is open in the workbench, and every change of it."""

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .. import Model, Robot
from .. import effects as registry
from ..cli.effects import DEFAULT_EFFECTS
from ..cli.errors import BadData
from ..cli.reading import ReadingOptions
from ..cli.robots import READY_MADE, load_robot
from .folder import ROLES, Folder, guessed_roles
from .logs import BY_HAND, CANNOT, UNREAD, Log, checked, judged, read, used
from .missing import Missing
from .models import Data, Models
from .remedies import proposals
from .steps import ROBOT_FILE, Ladder, Step
from .tracks import Track
from .work import Progress, Work

EMPTY: tuple[Any, ...] = (None, "", {}, [])


class Bench:
    """The state of the workbench; every method may be called from any thread."""

    def __init__(
        self, folder: Folder, robot: str | None = None, logs: list[str] | None = None, patience: float = 0.0
    ) -> None:
        """Opens a folder.

        - `patience`: s that reading waits for the first page: a long log would take the processor from it
        """
        self.shown = threading.Event()
        self.patience = patience
        self.folder = folder
        self.lock = threading.RLock()
        self.version = 0
        self.message: dict[str, str] | None = None
        self.unsaved: str | None = None
        self.robot: Robot | None = None
        self.robot_name: str | None = None
        self.robot_problem: str | None = None
        self.logs: dict[str, Log] = {}
        self.ladder = Ladder()
        self.models = Models(folder.root, self.ladder)
        self.missing = Missing(self.models, self.changed)
        self.checks: dict[str, Any] | None = None
        self.work = Work(self.changed)
        self._open(robot, logs)

    def changed(self) -> None:
        """Notes that pages show something old."""
        with self.lock:
            self.version += 1

    # Opening and keeping

    def _open(self, robot: str | None, logs: list[str] | None) -> None:
        data = self.folder.load()
        try:
            self.ladder.load(data)
        except BadData as error:
            raise BadData(f"{self.folder.file}: {error}") from error
        names = self.folder.logs() if logs is None else logs
        kept = {role: [n for n in data.get(role, []) if isinstance(n, str)] for role in ("train", "test")}
        known = {name: role for role, each in kept.items() for name in each}
        roles = {**guessed_roles(names), **(dict.fromkeys(names, "off") if known else {}), **known}
        found = robot or data.get("robot") or next(iter(self.folder.robots()), None)
        self.robot_name = found if isinstance(found, str) else None
        self._read_robot()
        # All of them from the beginning: what is saved meanwhile has the whole split.
        wanted = list(dict.fromkeys([*names, *known]))
        self.logs = {name: Log(name, roles.get(name, "off"), problem=UNREAD) for name in wanted}

        def task(progress: Progress) -> None:
            self.shown.wait(self.patience)
            for number, name in enumerate(wanted):
                progress(name, number, len(wanted))
                log = read(self.folder, self.robot, name, self.logs[name].role)
                with self.lock:
                    log.role = self.logs[name].role
                    self.logs[name] = log
                self.changed()
            if len(self.ladder.steps) > 1 and self.robot is not None and used(self.logs, "train"):
                self.compute(progress)

        self.work.start("open the folder", task, lambda text: self.say("bad", f"open the folder: {text}"))

    def save(self) -> None:
        """Writes the project file; what cannot be written is said, and tried again with the next change."""
        with self.lock:
            split = {role: [log.name for log in self.logs.values() if log.role == role] for role in ("train", "test")}
            entries = {"robot": self.robot_name, **split, **self.ladder.to_toml()}
            try:
                self.folder.save(entries)
                self.unsaved = None
            except (OSError, ValueError) as error:
                self.unsaved = (
                    f"{self.folder.file} cannot be written ({error}): what you do is kept only while this runs"
                )
            self.changed()

    def _read_robot(self) -> None:
        self.robot, self.robot_problem = None, None
        if self.robot_name is None:
            return
        try:
            path = self.robot_name if self.robot_name in READY_MADE else str(self.folder.path(self.robot_name))
            self.robot = load_robot(path)
        except CANNOT as error:
            self.robot_problem = str(error)

    # What is used

    def needs(self) -> Robot:
        """The robot, if there are a robot and training logs."""
        if self.robot is None:
            raise BadData(self.robot_problem or "there is no robot yet: put a URDF or a DH table into the folder")
        if not used(self.logs, "train"):
            raise BadData("no log trains: set one to `train`")
        return self.robot

    def reading(self) -> dict[str, Any] | None:
        """How logs like the training logs are read, as a model notes it."""
        first = next((log for log in self.logs.values() if log.role == "train"), None)
        return None if first is None else ReadingOptions().lasting([str(self.folder.path(first.name))])

    def data(self) -> Data:
        """What models follow from and are judged by."""
        robot, reading = self.needs(), self.reading()
        roles = {log.name: log.role for log in self.logs.values()}
        return Data(robot, used(self.logs, "train"), reading, judged(self.logs), roles)

    # Changes

    def set_robot(self, name: str) -> None:
        """Another robot."""
        with self.lock:
            if name not in READY_MADE:
                self.folder.path(name)
            self.robot_name = name
            self._read_robot()
            for log in list(self.logs.values()):
                self.logs[log.name] = read(self.folder, self.robot, log.name, log.role)
            self.save()
        self.refresh("fit with the other robot")

    def set_role(self, name: str, role: str) -> None:
        """What a log is for."""
        if role not in ROLES:
            raise BadData(f"{role}: a log is one of {', '.join(ROLES)}")
        with self.lock:
            self.log(name).role = role
            self.save()
        self.refresh("fit with the other split")

    def set_reading(self, name: str, settings: Mapping[str, Any]) -> None:
        """How a log is read, or, without a name, all logs of the folder; noted in the project file.

        A setting that is empty or None goes back to what is usual.
        """
        wrong = sorted(set(settings) - set(BY_HAND))
        if wrong:
            raise BadData(f"{wrong[0]}: not one of {', '.join(BY_HAND)}")
        with self.lock:
            if name:
                files = dict(self.folder.load().get("files", {}))
                key = Path(self.log(name).name).name
                files[key] = {k: v for k, v in {**files.get(key, {}), **settings}.items() if v not in EMPTY}
                self.folder.save({"files": {each: own for each, own in files.items() if own} or None})
            else:
                self.folder.save({key: None if value in EMPTY else value for key, value in settings.items()})
            for log in [self.log(name)] if name else list(self.logs.values()):
                self.logs[log.name] = read(self.folder, self.robot, log.name, log.role)
            self.message = None
            self.save()
        self.refresh("fit with the logs as they are read now")

    def log(self, name: object) -> Log:
        """The log of that name."""
        if str(name) not in self.logs:
            raise BadData(f"there is no log {name}")
        return self.logs[str(name)]

    def look_again(self) -> None:
        """Takes up files that came into the folder."""
        with self.lock:
            for name in self.folder.logs():
                if name not in self.logs:
                    self.logs[name] = read(self.folder, self.robot, name, guessed_roles([name, "x"])[name])
                elif self.logs[name].problem == UNREAD and self.work.state() is None:
                    self.logs[name] = read(self.folder, self.robot, name, self.logs[name].role)
            if self.robot is None:
                self.robot_name = next(iter(self.folder.robots()), None)
                self._read_robot()
            self.save()

    def fit(self, effects: list[str]) -> None:
        """A new fit, from the robot file."""
        self.needs()
        known = {effect["name"] for effect in registry()}
        for name in effects:
            if name not in known:
                raise BadData(f"there is no effect {name}")
        with self.lock:
            same = [step for step in self.ladder.steps.values() if step.after is None and step.id != ROBOT_FILE]
            title = "fit" if not same else f"fit {len(same) + 1}"
            self._begin(title, lambda: self.ladder.new(title, effects=effects))

    def add(self, effects: list[str], name: str | None = None, after: str | None = None) -> None:
        """A step that adds effects, `effect@joint`, to the current model or another one."""
        self.needs()
        if not effects:
            raise BadData("name an effect")
        with self.lock:
            start = self.ladder[after or self.ladder.current]
            if start.id == ROBOT_FILE:
                raise BadData("fit first: an effect is added to a fit")
            title = f"add {effects[0]}"
            given = name or in_words(effects)
            self._begin(title, lambda: self.ladder.new(given, after=start.id, add=effects))

    def _begin(self, title: str, make: Callable[[], Step]) -> None:
        before = self.ladder.current
        made: list[Step] = []

        def task(progress: Progress) -> None:
            with self.lock:
                made.append(make())
            self.compute(progress)
            self.save()

        def failed(text: str) -> None:
            with self.lock:
                for step in made:
                    if step.id in self.ladder.steps:
                        self.ladder.remove(step.id)
                self.ladder.current = before if before in self.ladder.steps else ROBOT_FILE
            self.say("bad", f"{title}: {text}")

        self.message = None
        self.work.start(title, task, failed)

    def refresh(self, title: str) -> None:
        """Computes all models again, because what they follow from has changed."""
        with self.lock:
            self.models.forget()
            self.missing.forget()
            self.checks = None
            self.changed()
            if len(self.ladder.steps) == 1 or self.robot is None or not used(self.logs, "train"):
                return
        self.work.cancel()
        self.work.wait()
        self.work.start(title, self.compute, lambda text: self.say("bad", f"{title}: {text}"))

    def compute(self, progress: Progress) -> None:
        """All models that are missing, in order; then their errors, and what was found to be missing in them."""
        data = self.data()
        with self.lock:
            steps = list(self.ladder.steps.values())
        for step in [*steps[1:], steps[0]]:
            if step.model is None:
                try:
                    self.models.make(step, data, progress)
                except CANNOT as error:
                    step.problem = str(error)
                    if not step.errors and step is steps[-1]:
                        raise
                    continue
            if not step.errors and step.model is not None:
                progress("errors of the models", 0, 0)
                self.models.judge(step, step.model, data)
                self.missing.restore(step, data)
        self.changed()

    def learn(self) -> None:
        """A last step: a Gaussian process for what the current model leaves over."""
        self.needs()
        with self.lock:
            start = self.ladder[self.ladder.current]
            if start.id == ROBOT_FILE or not isinstance(start.model, Model):
                raise BadData("the rest is learned of a model of physics alone: fit first, or go on from another step")
            self._begin("learn the rest", lambda: self.ladder.new("Gaussian process", after=start.id, rest=True))

    def diagnose(self) -> None:
        """Looks for what the current model lacks."""
        self.needs()
        step = self.ladder[self.ladder.current]
        model = step.model
        if step.id == ROBOT_FILE or model is None:
            raise BadData("fit first: a diagnosis starts from a fit")
        if not isinstance(model, Model):
            raise BadData("a Gaussian process takes all that is left: go on from the step before it")

        data = self.data()

        def task(progress: Progress) -> None:
            self.missing.look(step, model, data, progress)

        self.message = None
        self.work.start("look for what is missing", task, lambda text: self.say("bad", f"diagnosis: {text}"))

    def take_back(self) -> None:
        """The step before the current one becomes the current one; what is taken back stays in the ladder."""
        with self.lock:
            step = self.ladder[self.ladder.current]
            if step.after is None:
                raise BadData("this is a fit: there is nothing to take back")
            step.shown = False
            self.use(step.after)

    def use(self, name: str) -> None:
        """Goes on from a step."""
        with self.lock:
            self.ladder[name].shown = True
            self.ladder.current = name
            self.save()

    def remove(self, name: str) -> None:
        """Takes a step away for good, with those that start from it."""
        with self.lock:
            self.ladder.remove(name)
            self.models.forget_removed()
            self.save()

    def rename(self, name: str, to: str) -> None:
        """What a step is called."""
        with self.lock:
            self.ladder[name].name = to.strip()[:80] or name
            self.save()

    def show(self, name: str, shown: bool) -> None:
        """Whether a step is drawn."""
        with self.lock:
            self.ladder[name].shown = shown
            self.save()

    def pin(self, name: str | None) -> None:
        """The step that errors are compared with."""
        with self.lock:
            self.ladder.pinned = None if name is None else self.ladder[name].id
            self.save()

    def say(self, kind: str, text: str) -> None:
        """A line for the page."""
        with self.lock:
            self.message = {"kind": kind, "text": text}
            self.changed()

    # What pages show

    def track(self, name: str) -> Track:
        """The torque of a log, measured and by all models."""
        with self.lock:
            if name not in self.models.tracks:
                raise BadData(f"there is no prediction for {name} yet")
            return self.models.tracks[name]

    def check(self) -> dict[str, Any]:
        """What the physics says of the training logs; needs a fit."""
        with self.lock:
            self.needs()
            if self.checks is None:
                self.checks = checked(self.models.reference(), self.logs)
            return self.checks or {}

    def _proposals(self) -> list[dict[str, Any]]:
        """What the messages about logs in use propose."""
        used = [log for log in self.logs.values() if log.role != "off"]
        texts = [*(log.problem or "" for log in used), *(i["text"] for log in used for i in log.issues)]
        return proposals([*texts, "" if self.message is None else self.message["text"]])

    def to_dict(self) -> dict[str, Any]:
        """All that the page needs, without the lines of plots."""
        with self.lock:
            robot = self.robot
            try:
                checks = self.check()
            except CANNOT:
                checks = {}
            return {
                "version": self.version,
                "folder": self.folder.root.name,
                "path": str(self.folder.root),
                "message": self.message,
                "unsaved": self.unsaved,
                "job": self.work.state(),
                "robot": {
                    "name": self.robot_name,
                    "problem": self.robot_problem,
                    "joints": [] if robot is None else robot.joint_names,
                    "title": None if robot is None else robot.name,
                    "choices": [*self.folder.robots(), *READY_MADE],
                    "warnings": [] if robot is None else robot.warnings,
                },
                "logs": [log.to_dict() for log in self.logs.values()],
                "checks": checks,
                "proposals": self._proposals(),
                "effects": [{"name": e["name"], "summary": e["summary"]} for e in registry()],
                "usual_effects": list(DEFAULT_EFFECTS),
                "steps": [step.to_dict() for step in self.ladder.steps.values()],
                "current": self.ladder.current,
                "pinned": self.ladder.pinned,
                "diagnosis": self.missing.found.get(self.ladder.current),
                "hints": self.missing.hints.get(self.ladder.current, []),
                "ranked": self.missing.ranked.get(self.ladder.current),
            }


def in_words(effects: list[str]) -> str:
    """`torque_ripple@joint_2, torque_ripple@joint_3` as `torque ripple at joint_2, joint_3`."""
    kinds: dict[str, list[str]] = {}
    for each in effects:
        effect, _, joint = each.partition("@")
        kinds.setdefault(effect.replace("_", " "), []).append(joint)
    parts = [f"{kind} at {', '.join(joints)}" if any(joints) else kind for kind, joints in kinds.items()]
    return "; ".join(parts)
