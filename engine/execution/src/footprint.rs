//! Time and memory of a process and its descendants, to which limits apply.

use crate::{limits::Limits, world::fs};
use contract::trial_end::EndState;
use std::time::Duration;

/// The limit that a process exceeds, as the end state of its trial and as text; `None` if it exceeds none.
pub(crate) fn exceeded(limits: &Limits, elapsed: Duration, pid: u32) -> Option<(EndState, String)> {
    if let Some(limit) = limits.wall_time().filter(|limit| elapsed > *limit) {
        return Some((
            EndState::Timeout,
            format!("it took longer than the limit of {} s", limit.as_secs_f64()),
        ));
    }
    let limit = limits.memory_bytes()?;
    let held = held_beyond(pid, limit)?;
    let megabytes = |bytes: u64| bytes / 1_000_000;
    Some((
        EndState::Oom,
        format!(
            "it held {} MB of memory, above the limit of {} MB",
            megabytes(held),
            megabytes(limit)
        ),
    ))
}

/// Memory of a process and its descendants in bytes, if it is more than `limit`.
///
/// Resident memory is read quickly but counts shared pages several times, for example for a process that has just
/// copied itself; the proportional shares are summed only if resident memory exceeds the limit.
fn held_beyond(pid: u32, limit: u64) -> Option<u64> {
    let family = family(pid);
    let sum = |of: fn(u32) -> Option<u64>| family.iter().filter_map(|pid| of(*pid)).sum::<u64>();
    if sum(resident_bytes) <= limit {
        return None;
    }
    Some(sum(|pid| shared_out_bytes(pid).or_else(|| resident_bytes(pid)))).filter(|held| *held > limit)
}

/// Ids of a process and its descendants; only the process if the system does not report them.
pub(crate) fn family(pid: u32) -> Vec<u32> {
    let mut all = vec![pid];
    let mut at = 0;
    while let Some(pid) = all.get(at) {
        all.extend(children(*pid));
        at += 1;
    }
    all
}

/// Ids of the processes that the threads of a process started; empty if the system does not report them.
fn children(pid: u32) -> Vec<u32> {
    let threads = fs::read_dir(format!("/proc/{pid}/task"))
        .into_iter()
        .flatten()
        .flatten();
    let listed = threads.filter_map(|thread| fs::read_to_string(thread.path().join("children")).ok());
    let listed: Vec<String> = listed.collect();
    let ids = listed.iter().flat_map(|list| list.split_whitespace());
    ids.filter_map(|id| id.parse().ok()).collect()
}

/// Memory that a process holds, resident and swapped out, in bytes.
fn resident_bytes(pid: u32) -> Option<u64> {
    bytes_of(&format!("/proc/{pid}/status"), ["VmRSS:", "VmSwap:"])
}

/// Like [`resident_bytes`], with shared pages counted by their proportional share.
fn shared_out_bytes(pid: u32) -> Option<u64> {
    bytes_of(&format!("/proc/{pid}/smaps_rollup"), ["Pss:", "SwapPss:"])
}

/// Sum of two lines of a file of the system, in bytes; the second may be absent.
fn bytes_of(path: &str, [first, second]: [&str; 2]) -> Option<u64> {
    let text = fs::read_to_string(path).ok()?;
    let kilobytes = |key: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(key))?;
        line.split_whitespace().next()?.parse::<u64>().ok()
    };
    Some((kilobytes(first)? + kilobytes(second).unwrap_or(0)) * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    #[test]
    fn what_a_process_started_counts_with_it() {
        let mut child = Command::new("sh")
            .args(["-c", "sh -c 'sleep 60; true' & wait"])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let own = std::process::id();
        let all = || family(own).len();
        // The shell, the inner shell, and the command that the inner shell waits for.
        while family(child.id()).len() < 3 {
            std::thread::yield_now();
        }
        assert!(all() >= 4);
        assert!(held_beyond(own, 1_000).is_some_and(|held| held > 1_000_000));
        assert_eq!(held_beyond(own, u64::MAX), None);
        let started = family(child.id())[1..].to_vec();
        for pid in started {
            Command::new("kill").arg(pid.to_string()).status().unwrap();
        }
        child.wait().unwrap();
    }

    #[test]
    fn the_limit_that_is_passed_is_named() {
        let own = std::process::id();
        let limits = Limits {
            wall_time_s: Some(2.0),
            memory_mb: Some(1),
            ..Limits::default()
        };
        let of = |elapsed| exceeded(&limits, Duration::from_secs(elapsed), own).unwrap();
        assert_eq!(of(3).0, EndState::Timeout);
        assert_eq!(of(1).0, EndState::Oom);
        assert!(exceeded(&Limits::default(), Duration::from_secs(1000), own).is_none());
    }
}
