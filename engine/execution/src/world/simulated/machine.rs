//! The simulated world: machines, the processes on them, the disk that they share, time, and faults.

use super::{
    dice::Dice,
    disk::{Disk, Node},
};
use crate::world::process::{ProcessScope, ProcessState};
use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::{OsStr, OsString},
    io::{self, ErrorKind},
    path::{Path, PathBuf},
    time::Duration,
};

/// Possible faults, each with its probability at a call; after a number of calls none occurs.
#[derive(Debug, Clone, Copy, Default)]
pub struct Faults {
    /// Number of calls during which faults occur.
    pub calls: u64,
    /// A process is killed.
    pub kill: f64,
    /// A process halts for up to two minutes, like one that was suspended.
    pub halt: f64,
    /// All machines lose their power.
    pub power: f64,
    /// One machine loses its power.
    pub host_power: f64,
    /// The clock of a machine jumps by up to two hours, either way.
    pub clock: f64,
    /// A file operation fails, before or after it took effect.
    pub fail: f64,
    /// The disk is full for a while.
    pub full: f64,
    /// Longest time for which a machine may see the old names in a folder, unless it changed them itself.
    pub stale: Duration,
}

/// State that the processes share.
pub struct Machine {
    pub dice: Dice,
    /// Time since the beginning; no process can set it.
    pub time: Duration,
    pub disk: Disk,
    pub processes: Vec<SimulatedProcess>,
    /// Place of the process that has the turn; `None` if no process is left.
    pub turn: Option<usize>,
    /// The failure that ends the simulation.
    pub failed: Option<String>,
    /// Locked files, each with the holder's place in `processes`.
    pub locks: BTreeMap<Node, usize>,
    /// Line of the program whose flushes have no effect.
    pub without_flush: Option<String>,
    /// Lines of the program that flushed.
    pub flushed: BTreeSet<String>,
    /// Calls so far, if a trace is wanted.
    pub trace: Option<Vec<String>>,
    faults: Faults,
    calls: u64,
    full_until: Duration,
    hosts: Vec<Host>,
    next_pid: u32,
}

#[derive(Default)]
struct Host {
    boot: u64,
    /// Difference of its clock from the true time, in seconds.
    ahead_s: i64,
    /// Names in folders as it last saw them, with the time of reading.
    seen: BTreeMap<Node, (Duration, BTreeMap<OsString, Node>)>,
}

/// The process at one place of the simulation; a new one replaces it when it is gone.
pub struct SimulatedProcess {
    pub host: usize,
    pub pid: u32,
    /// Number that grows with every process at this place.
    pub generation: u64,
    pub state: ProcessLifetime,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProcessLifetime {
    /// Runs, or begins, from this time on.
    From(Duration),
    /// The process is over, and none replaces it.
    Over,
}

/// Number of calls after which a simulation counts as one without progress.
const MOST_CALLS: u64 = 400_000;
/// Date of the machines' clocks near the beginning.
const EPOCH: Duration = Duration::from_secs(1_800_000_000);

impl Machine {
    /// A world with a process at each place; `hosts_of` gives the machine of each.
    pub fn new(seed: u64, faults: Faults, hosts_of: &[usize]) -> Self {
        let mut dice = Dice::new(seed);
        let count = hosts_of.iter().max().map_or(0, |most| most + 1);
        let mut host = || Host {
            ahead_s: hours(&mut dice),
            ..Host::default()
        };
        let hosts: Vec<Host> = (0..count).map(|_| host()).collect();
        let mut machine = Self {
            turn: Some(dice.up_to(hosts_of.len() - 1)),
            dice,
            time: Duration::ZERO,
            disk: Disk::new(),
            processes: Vec::new(),
            failed: None,
            locks: BTreeMap::new(),
            without_flush: None,
            flushed: BTreeSet::new(),
            trace: None,
            faults,
            calls: 0,
            full_until: Duration::ZERO,
            hosts,
            next_pid: 100,
        };
        for host in hosts_of {
            let entry = SimulatedProcess {
                host: *host,
                pid: 0,
                generation: 0,
                state: ProcessLifetime::From(Duration::ZERO),
            };
            machine.processes.push(entry);
            machine.replace(machine.processes.len() - 1, Duration::ZERO);
        }
        machine
    }

    pub fn date(&self, host: usize) -> Duration {
        let ahead_s = self.hosts[host].ahead_s;
        let (by, time) = (Duration::from_secs(ahead_s.unsigned_abs()), self.disk_date());
        if ahead_s < 0 { time - by } else { time + by }
    }

    /// Date by the clock of the disk.
    pub fn disk_date(&self) -> Duration {
        EPOCH + self.time
    }

    pub fn place(&self, host: usize) -> ProcessScope {
        ProcessScope {
            host: format!("host-{host}"),
            boot: format!("boot-{}", self.hosts[host].boot),
        }
    }

    pub fn look(&self, host: usize, pid: u32) -> ProcessState {
        let runs = |entry: &&SimulatedProcess| {
            entry.host == host && entry.pid == pid && entry.state != ProcessLifetime::Over
        };
        match self.processes.iter().find(runs) {
            Some(entry) => ProcessState::Started(u64::from(entry.pid)),
            None => ProcessState::Gone,
        }
    }

    /// Whether faults can occur now.
    pub fn is_troubled(&self) -> bool {
        self.calls < self.faults.calls
    }

    /// Lets time pass; a fault may occur, and the turn may pass to another process.
    pub fn pass(&mut self, from: usize) {
        self.calls += 1;
        self.time += Duration::from_micros(self.dice.up_to(2000) as u64);
        if self.is_troubled() {
            self.strike();
        } else {
            self.full_until = Duration::ZERO;
        }
        if self.calls > MOST_CALLS {
            self.failed.get_or_insert("there is no progress".into());
        }
        let stays = self.is_ready(from) && self.dice.chance(0.6);
        if !stays {
            self.choose();
        }
    }

    fn is_ready(&self, at: usize) -> bool {
        matches!(self.processes[at].state, ProcessLifetime::From(time) if time <= self.time)
    }

    /// Gives the turn to any process that can run; time passes if all wait.
    pub fn choose(&mut self) {
        let times = self.processes.iter().filter_map(|entry| match entry.state {
            ProcessLifetime::From(time) => Some(time),
            ProcessLifetime::Over => None,
        });
        let Some(first) = times.min() else {
            self.turn = None;
            return;
        };
        self.time = self.time.max(first);
        let ready: Vec<usize> = (0..self.processes.len())
            .filter(|at| self.is_ready(*at))
            .collect();
        self.turn = Some(ready[self.dice.up_to(ready.len() - 1)]);
    }

    fn strike(&mut self) {
        let Faults {
            kill,
            halt,
            power,
            host_power,
            clock,
            full,
            ..
        } = self.faults;
        let all = self.processes.len() - 1;
        if self.dice.chance(kill) {
            let at = self.dice.up_to(all);
            self.note(|| format!("-- process {at} is killed"));
            self.kill(at);
        }
        if self.dice.chance(halt) {
            let at = self.dice.up_to(all);
            let wait = Duration::from_millis(self.dice.up_to(120_000) as u64);
            self.note(|| format!("-- process {at} halts for {wait:?}"));
            self.delay(at, wait);
        }
        if self.dice.chance(power) {
            self.lose_power();
        }
        if self.dice.chance(host_power) {
            let host = self.dice.up_to(self.hosts.len() - 1);
            self.note(|| format!("-- the power of machine {host} goes"));
            self.fall(host);
            self.disk.lose_host(host, &mut self.dice);
        }
        if self.dice.chance(clock) {
            let host = self.dice.up_to(self.hosts.len() - 1);
            self.hosts[host].ahead_s = hours(&mut self.dice);
        }
        if self.dice.chance(full) {
            self.full_until = self.time + Duration::from_millis(self.dice.up_to(2000) as u64);
        }
    }

    /// Simulates a loss of power of all machines.
    pub fn lose_power(&mut self) {
        self.note(|| "-- the power goes".into());
        for host in 0..self.hosts.len() {
            self.fall(host);
        }
        self.disk.lose_power(&mut self.dice);
    }

    /// Ends all processes of a machine, which starts again.
    fn fall(&mut self, host: usize) {
        for at in 0..self.processes.len() {
            if self.processes[at].host == host {
                self.kill(at);
            }
        }
        self.hosts[host].boot += 1;
        self.hosts[host].seen.clear();
    }

    fn kill(&mut self, at: usize) {
        if self.processes[at].state != ProcessLifetime::Over {
            let pause = Duration::from_millis(self.dice.up_to(60_000) as u64);
            self.replace(at, pause);
        }
    }

    /// Ends the process at a place; the next one begins after a pause.
    pub fn replace(&mut self, at: usize, pause: Duration) {
        self.locks.retain(|_, holder| *holder != at);
        self.next_pid += 1;
        let entry = &mut self.processes[at];
        entry.pid = self.next_pid;
        entry.generation += 1;
        entry.state = ProcessLifetime::From(self.time + pause);
    }

    /// Starts a new process at every place, sets the clocks right, and ends all faults.
    pub fn again(&mut self) {
        self.faults = Faults::default();
        self.calls = 0;
        self.hosts.iter_mut().for_each(|host| host.ahead_s = 0);
        for at in 0..self.processes.len() {
            self.replace(at, Duration::ZERO);
        }
        self.choose();
    }

    pub fn delay(&mut self, at: usize, wait: Duration) {
        if let ProcessLifetime::From(time) = &mut self.processes[at].state {
            *time = (*time).max(self.time + wait);
        }
    }

    /// Decides whether a file operation fails, and whether it takes effect first.
    pub fn fails(&mut self) -> Option<bool> {
        let fails = self.is_troubled() && self.dice.chance(self.faults.fail);
        fails.then(|| self.dice.chance(0.5))
    }

    pub fn is_full(&self) -> bool {
        self.time < self.full_until
    }

    /// The names in a folder as a machine sees them, which may be slightly outdated.
    pub fn seen(&mut self, host: usize, folder: Node, quiet: bool) -> io::Result<BTreeMap<OsString, Node>> {
        let now = self.disk.names(folder)?.now.clone();
        if quiet || self.faults.stale.is_zero() || !self.is_troubled() {
            return Ok(now);
        }
        match self.hosts[host].seen.get(&folder) {
            Some((when, names)) if self.time < *when + self.faults.stale => Ok(names.clone()),
            _ => {
                self.hosts[host].seen.insert(folder, (self.time, now.clone()));
                Ok(now)
            }
        }
    }

    /// The object of a path, as a machine sees it.
    pub fn find(&mut self, host: usize, path: &Path, quiet: bool) -> io::Result<Node> {
        let Ok((folder, name)) = self.disk.place(path) else {
            return self.disk.find(path);
        };
        self.seen(host, folder, quiet)?
            .get(name)
            .copied()
            .ok_or(ErrorKind::NotFound.into())
    }

    /// Changes names of folders; the machine that does so sees the current names from then on.
    pub fn change(&mut self, host: usize, names: Vec<(Node, &OsStr, Option<Node>)>) {
        for (folder, ..) in &names {
            self.hosts[host].seen.remove(folder);
        }
        let names = names
            .into_iter()
            .map(|(folder, name, to)| (folder, name.to_owned(), to));
        let at = self.disk_date();
        self.disk.change(names.collect(), at);
    }

    pub fn note(&mut self, what: impl FnOnce() -> String) {
        let time = self.time;
        if let Some(trace) = &mut self.trace {
            trace.push(format!("{:>10.3} {}", time.as_secs_f64(), what()));
        }
    }

    /// Paths of all files on the disk.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut found = Vec::new();
        let mut open = vec![(PathBuf::from("/"), super::disk::ROOT)];
        while let Some((path, node)) = open.pop() {
            match self.disk.names(node) {
                Ok(names) => open.extend(names.now.iter().map(|(name, node)| (path.join(name), *node))),
                Err(_) => found.push(path),
            }
        }
        found.sort();
        found
    }
}

/// Up to two hours, in seconds, either way.
fn hours(dice: &mut Dice) -> i64 {
    dice.up_to(14_400) as i64 - 7_200
}
