"""A server of HyperQueue, or a worker in a process of its own, until standard input ends.

    cluster.py server DIRECTORY
    cluster.py worker DIRECTORY OWN CORES
"""

import os
import sys

from hyperqueue.cluster import LocalCluster, WorkerConfig


def server(directory):
    return LocalCluster(directory)


def worker(directory, own, cores):
    # A worker of the package comes with a server of its own, and joins the one to which the link of its directory leads.
    cluster = LocalCluster(own)
    link = os.path.join(own, "hq-current")
    os.remove(link)
    os.symlink(os.path.realpath(os.path.join(directory, "hq-current")), link)
    cluster.start_worker(WorkerConfig(cores=int(cores)))
    return cluster


kept = {"server": server, "worker": worker}[sys.argv[1]](*sys.argv[2:])
print("begun", flush=True)
sys.stdin.read()
