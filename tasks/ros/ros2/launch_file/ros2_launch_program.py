"""The program that evaluates a launch file with ROS 2's own ``launch`` and ``launch_ros``, in ROS 2's Python.

It is text here, because that is another Python than Simyard's, and has the modules that it imports. Processes are
noted where ``launch`` would start them. It asks and answers as the stand-ins' program does.
"""

PROGRAM = r"""
import json, os, sys, tempfile
request = json.load(sys.stdin)
tempfile.tempdir = request["folder"]
from launch import LaunchContext
from launch.actions import ExecuteLocal, ExecuteProcess, RegisterEventHandler, Shutdown, TimerAction
from launch.launch_description_sources import AnyLaunchDescriptionSource
import launch_ros.actions

noted, before = [], dict(os.environ)
refused = (RegisterEventHandler, TimerAction, launch_ros.actions.LifecycleNode, launch_ros.actions.LoadComposableNodes,
           launch_ros.actions.ComposableNodeContainer)

def note(self, context):
    self.prepare(context)
    details = self.process_description
    given = dict(details.final_env if details.final_env is not None else context.environment)
    changes = {name: value for name, value in given.items() if before.get(name) != value}
    changes.update({name: "" for name in before if name not in given})
    command = list(details.final_cmd)
    if getattr(self, "_ExecuteLocal__shell", False):
        command = ["/bin/sh", "-c", " ".join(command)]
    ros = isinstance(self, launch_ros.actions.Node)
    name = "/" + os.path.basename(details.final_cmd[0])
    if ros and self.is_node_name_fully_specified():
        name = self.node_name
    noted.append({
        "name": name, "package": str(getattr(self, "node_package", "") or "") if ros else "",
        "kind": os.path.basename(details.final_cmd[0]), "ros": ros, "command": command,
        "environment": sorted(changes.items()), "cwd": details.final_cwd or "",
        "required": isinstance(getattr(self, "_ExecuteLocal__on_exit", None), Shutdown),
        "respawn": bool(getattr(self, "_ExecuteLocal__respawn", False)),
    })

ExecuteLocal.execute = note

def visit(entity, context):
    if isinstance(entity, refused):
        raise RuntimeError("%s is not done in lock-step: take it out of the launch file" % type(entity).__name__)
    for each in entity.visit(context) or ():
        visit(each, context)

try:
    context = LaunchContext()
    context.extend_locals({
        "current_launch_file_path": request["file"], "current_launch_file_directory": os.path.dirname(request["file"]),
    })
    visit(AnyLaunchDescriptionSource(request["file"]).get_launch_description(context), context)
    answer = {"processes": noted}
except (Exception, SystemExit) as exc:
    # What launch raises has no common root below Exception.
    answer = {"refused": " ".join(("%s: %s" % (type(exc).__name__, exc)).split())}
sys.stdout.write("\n" + json.dumps(answer) + "\n")
"""
