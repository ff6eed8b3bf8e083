"""What rospy counts by the wall's clock, it counts in simulated time here, as roscpp does by itself.

``rospy.wait_for_message`` and ``rospy.wait_for_service`` give up after seconds of the wall's clock, and a client of an
action looks each tenth of such a second whether its time is over. In lock-step that is another control step on each
machine, and no column would say so. A module that each Python of an episode imports as it starts hands them another
clock; no file of ROS, of a bundle or of an image changes.
"""

from pathlib import Path

# Runs in any Python 3 that has rospy. Simulated time begins at second 1 (BEGINS_NS), and stands while nodes start: what
# they wait for comes by the wall's clock until then. A node without /use_sim_time, and one before init_node, has the
# wall's clock as ever. Whoever had a sitecustomize before has it still.
_PROGRAM = '''
import importlib.machinery, importlib.util, os, sys, threading, time

_STANDS_S, _AGAIN_S = 1, 0.5
_conditions = []


class Instead:
    """A module some of whose names are others."""

    def __init__(self, module, **own):
        self.__dict__.update(own, module=module)

    def __getattr__(self, name):
        return getattr(self.module, name)


def seconds():
    now = _now()
    return time.time() if now is None else now.to_sec()


def sleep(seconds):
    begun, rostime = _now(), sys.modules["rospy.rostime"]
    if begun is None:
        time.sleep(seconds)
    elif begun <= rostime.Time(_STANDS_S):
        with rostime.get_rostime_cond():
            rostime.get_rostime_cond().wait(seconds)
    else:
        _wait(lambda now: now < begun or now >= begun + rostime.Duration.from_sec(seconds))


class Condition(threading.Condition):
    """Whoever waits for some time looks again at each tick."""

    def __init__(self):
        super().__init__()
        _conditions.append(self)

    def wait(self, timeout=None):
        now = _now()
        ticks = now is not None and now > sys.modules["rospy.rostime"].Time(_STANDS_S)
        return super().wait(_AGAIN_S if ticks and timeout is not None else timeout)


def _now():
    rostime = sys.modules["rospy.rostime"]
    if not rostime.is_rostime_initialized() or rostime.is_wallclock():
        return None
    return _wait(lambda now: not now.is_zero())


def _wait(there):
    """Returns the first simulated time for which something holds, or the last one of a node that ends."""
    rostime, core = sys.modules["rospy.rostime"], sys.modules["rospy.core"]
    with rostime.get_rostime_cond():
        while not there(rostime.get_rostime()) and not core.is_shutdown():
            rostime.get_rostime_cond().wait(_AGAIN_S)
    return rostime.get_rostime()


def _of_rospy(_):
    for each in ("rospy.client", "rospy.impl.tcpros_service"):
        sys.modules[each].time = Instead(time, time=seconds, sleep=sleep)
    simtime = sys.modules["rospy.impl.simtime"]
    set_rostime = simtime._set_rostime

    def tick(now):
        set_rostime(now)
        for each in _conditions:
            with each:
                each.notify_all()

    simtime._set_rostime = tick


def _of_actionlib(module):
    module.threading = Instead(threading, Condition=Condition)


class Finder:
    """Finds modules as they are found without, and hands them the clock once they are imported."""

    hands = {"rospy": _of_rospy, "actionlib.simple_action_client": _of_actionlib}

    def find_spec(self, name, path=None, target=None):
        found = importlib.machinery.PathFinder.find_spec(name, path) if name in self.hands else None
        if found is None or found.loader is None:
            return None
        execute = found.loader.exec_module

        def exec_module(module):
            execute(module)
            self.hands[name](module)

        found.loader.exec_module = exec_module
        return found


sys.meta_path.insert(0, Finder())
_own = os.path.realpath(os.path.dirname(__file__))
_others = [each for each in sys.path if os.path.realpath(each) != _own]
_next = importlib.machinery.PathFinder.find_spec(__name__, _others)
if _next is not None and _next.loader is not None:
    sys.modules[__name__] = importlib.util.module_from_spec(_next)
    _next.loader.exec_module(sys.modules[__name__])
'''


def with_simulated_waits(home: Path, python_path: str) -> str:
    """Returns the ``PYTHONPATH`` of nodes whose waits count simulated time.

    Args:
        home: The episode's folder, which the nodes see by the same name; the module is put there.
        python_path: What they have without; it comes after.
    """
    folder = home / "python"
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(_PROGRAM)
    return ":".join(filter(None, (str(folder), python_path)))
