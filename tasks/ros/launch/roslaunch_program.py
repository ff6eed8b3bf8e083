"""The program that runs in ROS's own Python: roslaunch says what it would start.

It is text here, because ROS's Python is another one than Simyard's, and has the modules that it imports. Whatever
roslaunch refuses comes back as a sentence; whatever Simyard does not do for a launch file is a sentence as well.
"""

PROGRAM = r'''
import base64, json, os, sys
import rospkg, roslaunch.config, roslaunch.core, roslaunch.node_args, roslaunch.xmlloader, xmlrpc.client


class Refused(Exception):
    pass


def launch_file(package, name):
    """Finds a launch file as roslaunch does: its path in the package, its launch folder, anywhere below."""
    try:
        folder = rospkg.RosPack(rospkg.get_ros_paths()).get_path(package)
    except rospkg.ResourceNotFound:
        raise Refused("there is no ROS package %r in the bundle or in ROS" % package)
    for path in (os.path.join(folder, name), os.path.join(folder, "launch", name)):
        if os.path.isfile(path):
            return path
    found = [
        os.path.join(root, each) for root, folders, files in sorted(os.walk(folder)) for each in files if each == name
    ]
    if len(found) > 1:
        raise Refused("%s has more than one %s: %s" % (package, name, ", ".join(sorted(found))))
    if not found:
        raise Refused("the package %s has no launch file %r" % (package, name))
    return found[0]


def node(each, machine):
    # The resolved command holds the names that $(anon ...) stands for.
    command = roslaunch.node_args.create_local_process_args(each, machine)
    folder = ""
    if each.cwd == "node":
        prefix = len(each.launch_prefix.split()) if each.launch_prefix else 0
        folder = os.path.dirname(command[prefix])
    return {
        "name": each.namespace + each.name, "package": each.package, "kind": each.type, "command": command,
        "environment": [[str(name), str(value)] for name, value in each.env_args], "namespace": each.namespace,
        "cwd": folder, "required": bool(each.required), "respawn": bool(each.respawn),
    }


def binary(value):
    if isinstance(value, xmlrpc.client.Binary):
        return {"binary": base64.b64encode(value.data).decode()}
    raise Refused("a parameter is a %s, which no ROS parameter can be" % type(value).__name__)


def resolved(package, name):
    config, path = roslaunch.config.ROSLaunchConfig(), launch_file(package, name)
    loader = roslaunch.xmlloader.XmlLoader()
    # load_config_default sets it, and reads roscore.xml, of which nothing is started here.
    loader.ignore_unset_args = False
    loader.load(path, config, argv=[], verbose=False)
    if config.config_errors:
        raise Refused("; ".join(config.config_errors))
    commands = [each for each in getattr(config, "executables", []) if each is not None]
    if commands:
        raise Refused("<rosparam> with command dump or delete is not done: a new parameter server has nothing yet")
    for each in config.nodes:
        if each.machine_name:
            given = config.machines.get(each.machine_name)
            if given is None:
                raise Refused("node %s names the machine %r, which is not declared" % (each.name, each.machine_name))
            if given.address not in ("localhost", "127.0.0.1", "::1"):
                raise Refused(
                    "node %s is for the machine %s: all nodes of an episode run on one machine; "
                    "take the attribute machine away" % (each.name, given.address)
                )
    local = roslaunch.core.local_machine()
    return {
        "file": path, "nodes": [node(each, local) for each in config.nodes],
        "parameters": {key: param.value for key, param in config.params.items()},
    }


def answer(package, name, environment):
    os.environ.clear()
    os.environ.update(environment)
    try:
        return json.dumps(resolved(package, name), default=binary)
    except Exception as exc:
        # What roslaunch raises has no common root below Exception.
        text = " ".join(str(exc).split()) or type(exc).__name__
        package, paths, _ = text.partition(" ROS path [0]=")
        if paths:
            text = "there is no ROS package %r in the bundle or in ROS: put it into the bundle, or install it" % package
        return json.dumps({"refused": text.replace(os.environ.get("ROS_PACKAGE_PATH", "").split(":")[0] + "/", "")})


answers = [answer(sys.argv[1], sys.argv[2], each) for each in json.load(sys.stdin)]
sys.stdout.write("\n" + json.dumps(answers))
'''
