"""Hands tasks to a server of HyperQueue, and asks how many of them have ended.

    client.py submit DIRECTORY REQUEST    the path of a request; answers the job
    client.py count DIRECTORY JOBS        a list of numbers in JSON; answers what has ended of each

DIRECTORY is that of the server, or empty for the usual one. The last line of the output is the answer in JSON:
{"done": ...}, {"busy": why} where the same question may be answered later, or {"refused": why}.
"""

import datetime
import json
import os
import sys

# With -c the current folder comes first, and a folder of its name in it would hide the package.
sys.path = [folder for folder in sys.path if folder]


class Busy(Exception):
    pass


class Refused(Exception):
    pass


class Counted(Exception):
    pass


def main(verb, directory, argument):
    directory = os.path.expanduser(directory or os.environ.get("HQ_SERVER_DIR") or "~/.hq-server")
    try:
        answer = {"done": {"submit": submit, "count": count}[verb](directory, argument)}
    except Busy as why:
        answer = {"busy": str(why)}
    except Refused as why:
        answer = {"refused": str(why)}
    print("\n" + json.dumps(answer))


def submit(directory, path):
    with open(path) as file:
        request = json.load(file)
    uid = server(directory)
    noted = note(request["note"])
    # Whoever asked for it may have died, or lost patience, before the answer.
    if noted and noted["server"] == uid:
        return noted
    hq, client = connect(directory, uid)
    try:
        job = client.submit(job_of(hq, request))
    except Exception as error:
        lost = any(word in text(error).lower() for word in ("connect", "unreachable", "closed", "pipe"))
        raise (Busy if lost else Refused)(text(error)) from None
    noted = {"server": uid, "job": job.id}
    keep(request["note"], noted)
    return noted


def count(directory, jobs):
    uid = server(directory)
    _, client = connect(directory, uid)
    counts = {}

    # The client asks once a second until all jobs have ended, and tells what it heard: once is enough.
    def told(status):
        counts.update(status)
        raise Counted

    try:
        client.connection.wait_for_jobs(json.loads(jobs), told)
    except Counted:
        pass
    except Exception as error:
        raise Busy(text(error)) from None
    return {"server": uid, "jobs": counts}


def job_of(hq, request):
    from hyperqueue.ffi.protocol import ResourceRequest

    # A worker that fails says nothing about the others.
    job = hq.Job(max_fails=None, name=request["name"])
    seconds = request["min_time_s"]
    cards = {"gpus/nvidia": request["gpus"]} if request["gpus"] else None
    for _ in range(request["tasks"]):
        min_time = datetime.timedelta(seconds=seconds) if seconds else None
        resources = ResourceRequest(cpus=request["cpus"], min_time=min_time, resources=cards)
        job.program(request["command"], cwd=request["folder"], stdout=None, stderr=None, resources=resources)
    return job


def connect(directory, uid):
    try:
        import hyperqueue
    except ImportError as error:
        raise Refused(
            f"`{sys.executable}` cannot import the package `hyperqueue` ({error}): install it in the version of the "
            f"server, as in `{sys.executable} -m pip install hyperqueue==0.27.0`, or name the Python that has it with "
            "`python` in [hyperqueue] of regimen.toml"
        ) from None
    try:
        client = hyperqueue.Client(directory)
    except Exception as error:
        wrong = "version" in text(error).lower()
        raise (Refused if wrong else Busy)(text(error)) from None
    if server(directory) != uid:
        raise Busy(f"the server of `{directory}` has just been replaced")
    return hyperqueue, client


def server(directory):
    """The server's own name: numbers of jobs mean something together with it only."""
    for folder in (os.path.join(directory, "hq-current"), directory):
        try:
            with open(os.path.join(folder, "access.json")) as file:
                return json.load(file)["server_uid"]
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (OSError, ValueError, KeyError) as error:
            raise Busy(f"`{folder}/access.json` cannot be read: {error}") from None
    raise Refused(
        f"no server of HyperQueue has its directory at `{directory}`: start one with `hq server start`, or say where it is "
        "with `server_dir` in [hyperqueue] of regimen.toml"
    )


def note(path):
    try:
        with open(path) as file:
            return json.load(file)
    except (FileNotFoundError, ValueError):
        return None


def keep(path, noted):
    with open(path + ".new", "w") as file:
        json.dump(noted, file)
        file.flush()
        os.fsync(file.fileno())
    os.replace(path + ".new", path)


def text(error):
    """What went wrong, without the traces of the package's own calls."""
    lines = str(error).split("Stack backtrace")[0].splitlines()
    return "; ".join(line.strip() for line in lines if line.strip() and line.strip() != "Caused by:")


main(*sys.argv[1:])
