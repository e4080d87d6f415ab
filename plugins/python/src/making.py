

# --- Makers of environments and agents
# ----------------------------------------------------------------------------------


class Sources(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Modules from texts in the request: a trial runs the sources that its id names, even if the files change."""

    def __init__(self, files):
        self.files = {os.path.splitext(os.path.basename(file["path"]))[0]: file for file in files}

    def find_spec(self, name, path=None, target=None):
        file = self.files.get(name)
        return file and importlib.util.spec_from_loader(name, self, origin=file["path"])

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        file = self.files[module.__name__]
        path, text = file["path"], file["text"]
        module.__file__ = path
        linecache.cache[path] = (len(text), None, text.splitlines(True), path)
        exec(compile(text, path, "exec"), module.__dict__)


def function_of(make, sources):
    """The call that makes an environment or an agent."""
    if "file" in make:
        sys.meta_path.insert(0, Sources([make["file"], *sources]))
        module = importlib.import_module(os.path.splitext(os.path.basename(make["file"]["path"]))[0])
        if not callable(getattr(module, make["call"], None)):
            raise Refused("make", f"`{make['file']['path']}` has no function `{make['call']}`{others(module, make['call'])}")
        return getattr(module, make["call"])
    sys.meta_path.insert(0, Sources(sources))
    package, name = make["package"], make["name"]
    if package == "gymnasium":
        import gymnasium

        return lambda **arguments: gymnasium.make(name, **{"disable_env_checker": True, **arguments})
    return parallel_function(name)


def others(module, name):
    """Advice with the functions and classes that a module defines, the one with the most similar name first."""
    import difflib

    own = [key for key, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__]
    own = sorted(key for key in own if callable(getattr(module, key)) and not key.startswith("_"))
    near = difflib.get_close_matches(name, own, 1)
    meant = f"; did you mean `{near[0]}`?" if near else ";"
    return f"{meant} it has {', '.join(f'`{key}`' for key in own[:20]) or 'none'}"


def parallel_function(name):
    """`parallel_env` of `pettingzoo.NAME`, or of `NAME` if that module does not exist."""
    try:
        module = importlib.import_module(f"pettingzoo.{name}")
    except ModuleNotFoundError as error:
        if not f"pettingzoo.{name}".startswith(error.name or " "):
            raise
        module = module_outside(name, error)
    if not hasattr(module, "parallel_env"):
        raise Refused("make", f"`{module.__name__}` has no parallel interface: it has no function `parallel_env`")
    return module.parallel_env


def module_outside(name, error):
    """A module of another package; the error for a missing one names similar modules of the package."""
    refuse_other_version(error.name)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as other:
        if not name.startswith(other.name or " "):
            raise
        refuse_other_version(other.name)
        packages = ", ".join(it for it in modules_of("pettingzoo") if it not in ("test", "utils"))
        raise Refused(
            "make",
            f"there is neither `pettingzoo.{name}` nor `{name}` in this Python: PettingZoo has {packages or 'nothing'}; "
            "another package is to be installed under its own name, with its version in the lock file",
        ) from None


def refuse_other_version(missing):
    """Names the modules that a package has in place of a missing one."""
    package, _, last = missing.rpartition(".")
    if not package:
        return
    like = [it for it in modules_of(package) if stem(it) == stem(last)]
    like = [it for it in like if it != stem(it)] or like
    if like or "." in package:
        known = like or [it for it in modules_of(package) if it != stem(it)]
        raise Refused("make", f"{package} has no {last}; it has {', '.join(known) or 'nothing of the kind'}")


def modules_of(package):
    """Names of the modules in a package; empty if it is not a package."""
    try:
        return [it.name for it in pkgutil.iter_modules(importlib.import_module(package).__path__)]
    except (ImportError, AttributeError):
        return []


def stem(name):
    """A name without its version."""
    return re.sub(r"_v\d+$", "", name)


def found_module(asked, needed):
    make, interpreter = asked["make"], asked["interpreter"]
    try:
        for package in needed:
            importlib.import_module(package)
        return function_of(make, asked["sources"])
    except ModuleNotFoundError as error:
        # A name from the study could be that of a stranger's package, so only pinned packages are named.
        missing = plain((error.name or "").split(".")[0])
        pinned = missing in dict(versions_in(asked["lock"]["path"], asked["lock"]["text"]))
        install = f"`{interpreter} -m pip install {missing}` installs a package for this Python; " if pinned else ""
        own = ", and a file of your own is named under `sources`, as in `sources: [{ file: model.py }]`"
        raise Refused(
            "make",
            f"{told(error)}\n{install}another Python is named under `interpreter`{own if 'file' in make else ''}",
        ) from error


# --- The lock file -------------------------------------------------------------------------------------------


def versions_in(path, text):
    """Names and versions of packages, of `name==version` lines or of a lock file in TOML."""
    if path.endswith((".toml", ".lock")):
        import tomllib

        document = tomllib.loads(text)
        packages = document.get("package", []) + document.get("packages", [])
        return [(plain(package["name"]), package["version"]) for package in packages if "version" in package]
    pinned = re.findall(r"^\s*(?:- )?([A-Za-z0-9][\w.-]*)(?:\[[^\]]*\])?\s*==\s*([^\s;\\#]+)", text, re.MULTILINE)
    return [(plain(name), version) for name, version in pinned]


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def found_beside_wanted(lock):
    """For each package of a lock file: the installed version, or `None`, and the wanted versions."""
    from importlib.metadata import PackageNotFoundError, version

    # A lock file for several platforms may name several versions of one package.
    wanted = {}
    for name, expected in versions_in(lock["path"], lock["text"]):
        wanted.setdefault(name, []).append(expected)
    found = {}
    for name, expected in wanted.items():
        try:
            found[name] = (version(name), expected)
        except PackageNotFoundError:
            found[name] = (None, expected)
    return found


def how_to_install(lock, interpreter):
    if lock["path"].endswith((".toml", ".lock")):
        return f"install what `{lock['path']}` says"
    return f"`{interpreter} -m pip install -r {lock['path']}` installs what it says"


def hold_against_lock(lock, interpreter, needed):
    """The id of a trial contains the lock file, so the installed packages must match it, and `needed` must be in it."""
    packages = found_beside_wanted(lock)
    if needed not in packages:
        raise Refused(
            "lock", f"`{lock['path']}` pins no version of {needed}: write it by `{interpreter} -m pip freeze`"
        )
    different = [
        f"{name} {found} in place of {' or '.join(expected)}"
        for name, (found, expected) in packages.items()
        # A lock file may hold packages of other platforms.
        if found and found.split("+")[0] not in [version.split("+")[0] for version in expected]
    ]
    if different:
        raise Refused(
            "lock",
            f"installed is not what `{lock['path']}` says: {', '.join(different)}; {how_to_install(lock, interpreter)}, and "
            f"`{interpreter} -m pip freeze` writes it anew, which makes new trials",
            lacks=True,
        )


def is_of_an_import(error):
    # Gymnasium has its own error for packages that single environments need.
    return isinstance(error, ImportError) or type(error).__name__ == "DependencyNotInstalled"


def refusal(error, lock, interpreter):
    """The refusal for the program that asked. If a module cannot be imported and a package of the lock file is
    missing, this machine lacks a package, and neither the study nor its code is wrong."""
    key, lacks = getattr(error, "key", "make"), getattr(error, "lacks", False)
    problem = str(error) if isinstance(error, Refused) else told(error)
    cause = error.__cause__ if isinstance(error, Refused) else error
    if is_of_an_import(cause):
        missing = [f"{name} {' or '.join(wanted)}" for name, (found, wanted) in found_beside_wanted(lock).items() if not found]
        if missing:
            lacks, install = True, how_to_install(lock, interpreter)
            problem = f"needs {', '.join(missing)}, which this Python lacks; {install}\n{problem}"
    return json.dumps({"key": key, "problem": problem, "lacks": lacks}).encode()
