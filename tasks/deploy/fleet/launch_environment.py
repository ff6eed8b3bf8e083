"""Environment variables of an application on a robot: fixed ones, the launch configuration's, and tags."""

import fnmatch
import re
import shutil
from collections.abc import Iterable, Mapping

from specs.base import Fault
from specs.program_file import needed_programs

TAG_PREFIX = "AWS_ROBOMAKER_ROBOT_TAG_KEY_"
BASE_VARIABLES: Mapping[str, str] = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "LANG": "C.UTF-8",
}
ALLOWED = "no variable that changes which code a shell, loader or interpreter runs, and none of Simyard's own"
REFUSED: Mapping[str, str] = {
    "the loader and the C library": (
        "LD_* DYLD_* GCONV_PATH GLIBC_* MALLOC_* LOCPATH NLSPATH GETCONF_DIR TZDIR HOSTALIASES LOCALDOMAIN "
        "RES_OPTIONS RESOLV_HOST_CONF NIX_LD*"
    ),
    "shells": (
        "PATH ENV IFS PS[0-4] HOME SHELLOPTS BASHOPTS BASH_* PROMPT_COMMAND CDPATH FPATH ZDOTDIR GLOBIGNORE FCEDIT "
        "HISTFILE"
    ),
    "Python": "PYTHON*",
    "Perl": "PERL5* PERL_* PERLLIB PERLIO*",
    "Ruby": "RUBY* GEM_HOME GEM_PATH BUNDLE_*",
    "Node.js": "NODE_* NPM_CONFIG_* ELECTRON_*",
    "Java": (
        "JAVA_* JDK_JAVA_OPTIONS JDK_JAVAC_OPTIONS _JAVA_OPTIONS IBM_JAVA_OPTIONS OPENJ9_JAVA_OPTIONS CLASSPATH "
        "JRE_HOME"
    ),
    "Lua": "LUA_INIT* LUA_PATH* LUA_CPATH*",
    "PHP": "PHPRC PHP_INI_SCAN_DIR",
    ".NET and Mono": "DOTNET_STARTUP_HOOKS DOTNET_ROOT* CORECLR_* COR_* MONO_*",
    "other interpreters": (
        "TCLLIBPATH TCL_LIBRARY TK_LIBRARY GUILE_* JULIA_* ERL_* R_HOME R_PROFILE* R_ENVIRON* R_LIBS* AWKPATH "
        "AWKLIBPATH GHC_PACKAGE_PATH EMACSLOADPATH"
    ),
    "OpenSSL": "OPENSSL_*",
    "Git": "GIT_*",
    "compilers and make": "GCC_EXEC_PREFIX COMPILER_PATH LIBRARY_PATH MAKEFILES MAKEFLAGS RUSTC_WRAPPER RUSTC GOFLAGS",
    "programs that start a pager, an editor or a browser": (
        "PAGER MANPAGER LESSOPEN LESSCLOSE EDITOR VISUAL BROWSER SUDO_* SSH_ASKPASS"
    ),
    "Qt": (
        "QT_PLUGIN_PATH QT_QPA_PLATFORM_PLUGIN_PATH QT_QPA_GENERIC_PLUGINS QML_IMPORT_PATH QML2_IMPORT_PATH "
        "QTWEBENGINEPROCESS_PATH"
    ),
    "GTK and GLib": "GTK_* GTK2_* GTK3_* GIO_* GI_TYPELIB_PATH GDK_PIXBUF_* GSETTINGS_*",
    "GStreamer": "GST_PLUGIN_* GST_REGISTRY* GST_PRESET_PATH",
    "drivers": (
        "LIBGL_DRIVERS_PATH LIBVA_DRIVERS_PATH VK_LAYER_PATH VK_INSTANCE_LAYERS VK_LOADER_* CUDA_INJECTION* "
        "OCL_ICD_* ALSA_CONFIG_* LADSPA_PATH"
    ),
    "Simyard": "SIMYARD_*",
}
"""Who reads code, or where it lies, from which variables; ``*`` is any text, ``[0-4]`` one of these.

No application may set them. Those of ROS stay allowed (``ROS_*``, ``RMW_IMPLEMENTATION``, ``AMENT_PREFIX_PATH``): a ROS
application cannot be started without them.
"""
_REFUSED = re.compile("|".join(fnmatch.translate(each) for names in REFUSED.values() for each in names.split()))


def environment(
    variables: Mapping[str, str], robot_tags: Mapping[str, str], deployment_tags: Mapping[str, str]
) -> dict[str, str]:
    """Returns what a configuration and tags add to `BASE_VARIABLES`; a deployment's tag wins over its robot's.

    See docs/reference/robomaker.md, section 9.
    """
    tags = {f"{TAG_PREFIX}{key}": value for key, value in {**robot_tags, **deployment_tags}.items()}
    return {**variables, **tags}


def absent_program(head: bytes) -> str:
    """Returns the first of the programs that a script needs to start which this machine lacks; empty if none is.

    Args:
        head: The script's first bytes.
    """
    needed = needed_programs(head)
    return next((name for name in needed if shutil.which(name, path=BASE_VARIABLES["PATH"]) is None), "")


def variable_faults(names: Iterable[str], path: str) -> list[Fault]:
    """Returns a fault for each variable that a document may not set; ``path`` is where the document has them."""
    return [Fault(path=f"{path}.{name}", value=name, allowed=ALLOWED) for name in names if _REFUSED.match(name)]
