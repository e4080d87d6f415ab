//! A disk that keeps flushed changes, and a random part of the others.
//!
//! Every process sees every change at once. A change becomes durable when the changed object is flushed: bytes with
//! their file, names with their folder. At a loss of power, a file keeps a random prefix of its unflushed writes, the
//! last of them possibly in part; a folder keeps a random prefix of its unflushed changes. A rename between two folders
//! happens in both or in neither. This is less than journalling file systems promise, and everything that the store may
//! rely on.

use super::dice::Dice;
use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::{OsStr, OsString},
    io::{self, ErrorKind},
    path::{Component, Path},
    time::Duration,
};

/// Number of a file or folder.
pub type Node = usize;

/// The root folder.
pub const ROOT: Node = 0;

pub struct Disk {
    nodes: Vec<Inode>,
    /// Number of changes of names so far.
    changes: u64,
    /// Changes of two folders that are durable in one of them.
    durable: BTreeSet<u64>,
}

pub struct Inode {
    pub body: Body,
    /// Time of the last change, by the clock of the disk.
    pub changed: Duration,
}

pub enum Body {
    File(Content),
    Folder(Names),
}

#[derive(Default)]
pub struct Content {
    pub bytes: Vec<u8>,
    durable: Vec<u8>,
    unflushed: Vec<UnflushedWrite>,
}

/// A change of a file, and the machine whose memory holds it until it is flushed.
struct UnflushedWrite {
    host: usize,
    change: Change,
}

enum Change {
    Write { at: usize, bytes: Vec<u8> },
    Cut(usize),
}

#[derive(Default)]
pub struct Names {
    pub now: BTreeMap<OsString, Node>,
    durable: BTreeMap<OsString, Node>,
    unflushed: Vec<NameChange>,
}

/// Names that one change gave and removed in one folder.
struct NameChange {
    number: u64,
    names: Vec<(OsString, Option<Node>)>,
}

impl Disk {
    pub fn new() -> Self {
        let root = Inode {
            body: Body::Folder(Names::default()),
            changed: Duration::ZERO,
        };
        Self {
            nodes: vec![root],
            changes: 0,
            durable: BTreeSet::new(),
        }
    }

    pub fn node(&self, node: Node) -> &Inode {
        &self.nodes[node]
    }

    pub fn touch(&mut self, node: Node, at: Duration) {
        self.nodes[node].changed = at;
    }

    pub fn is_folder(&self, node: Node) -> bool {
        matches!(self.nodes[node].body, Body::Folder(_))
    }

    pub fn names(&self, node: Node) -> io::Result<&Names> {
        match &self.nodes[node].body {
            Body::Folder(names) => Ok(names),
            Body::File(_) => Err(ErrorKind::NotADirectory.into()),
        }
    }

    pub fn content(&self, node: Node) -> io::Result<&Content> {
        match &self.nodes[node].body {
            Body::File(content) => Ok(content),
            Body::Folder(_) => Err(ErrorKind::IsADirectory.into()),
        }
    }

    fn content_of(&mut self, node: Node) -> io::Result<&mut Content> {
        match &mut self.nodes[node].body {
            Body::File(content) => Ok(content),
            Body::Folder(_) => Err(ErrorKind::IsADirectory.into()),
        }
    }

    /// The file or folder to which a path leads.
    pub fn find(&self, path: &Path) -> io::Result<Node> {
        let mut node = ROOT;
        for name in parts(path) {
            node = *self.names(node)?.now.get(name).ok_or(ErrorKind::NotFound)?;
        }
        Ok(node)
    }

    /// The folder of a path's last name, and that name.
    pub fn place<'a>(&self, path: &'a Path) -> io::Result<(Node, &'a OsStr)> {
        let name = path.file_name().ok_or(ErrorKind::InvalidInput)?;
        let folder = self.find(path.parent().unwrap_or(Path::new("")))?;
        self.names(folder)?;
        Ok((folder, name))
    }

    /// A new file or folder without a name.
    pub fn make(&mut self, folder: bool, at: Duration) -> Node {
        let body = if folder {
            Body::Folder(Names::default())
        } else {
            Body::File(Content::default())
        };
        self.nodes.push(Inode { body, changed: at });
        self.nodes.len() - 1
    }

    /// Gives and removes names in one or two folders, all at once.
    pub fn change(&mut self, names: Vec<(Node, OsString, Option<Node>)>, at: Duration) {
        self.changes += 1;
        let folders: BTreeSet<Node> = names.iter().map(|(folder, ..)| *folder).collect();
        for folder in folders {
            let of = names.iter().filter(|(of, ..)| *of == folder);
            let renamed = NameChange {
                number: self.changes,
                names: of.map(|(_, name, to)| (name.clone(), *to)).collect(),
            };
            let inode = &mut self.nodes[folder];
            inode.changed = at;
            if let Body::Folder(names) = &mut inode.body {
                renamed.apply(&mut names.now);
                names.unflushed.push(renamed);
            }
        }
    }

    /// Writes bytes, and zeros before them if the file is shorter.
    pub fn write(&mut self, node: Node, at: usize, bytes: &[u8], host: usize) -> io::Result<()> {
        let change = Change::Write {
            at,
            bytes: bytes.to_vec(),
        };
        self.alter(node, UnflushedWrite { host, change })
    }

    pub fn cut(&mut self, node: Node, length: usize, host: usize) -> io::Result<()> {
        let change = Change::Cut(length);
        self.alter(node, UnflushedWrite { host, change })
    }

    fn alter(&mut self, node: Node, written: UnflushedWrite) -> io::Result<()> {
        let content = self.content_of(node)?;
        written.change.apply(&mut content.bytes);
        content.unflushed.push(written);
        Ok(())
    }

    /// Makes the content of a file, or the names in a folder, durable.
    pub fn flush(&mut self, node: Node) {
        match &mut self.nodes[node].body {
            Body::File(content) => {
                content.unflushed.clear();
                content.durable.clone_from(&content.bytes);
            }
            Body::Folder(names) => {
                self.durable
                    .extend(names.unflushed.drain(..).map(|renamed| renamed.number));
                names.durable.clone_from(&names.now);
            }
        }
    }

    /// Simulates a loss of power of the disk and all machines.
    pub fn lose_power(&mut self, dice: &mut Dice) {
        let mut kept = self.kept(dice);
        for (node, inode) in self.nodes.iter_mut().enumerate() {
            match &mut inode.body {
                Body::File(content) => {
                    content.lose(dice, |_| true);
                    content.unflushed.clear();
                    content.durable.clone_from(&content.bytes);
                }
                Body::Folder(names) => names.lose(kept.remove(&node).unwrap_or(0)),
            }
        }
    }

    /// Simulates a loss of power of one machine: unflushed writes in its memory are lost.
    pub fn lose_host(&mut self, host: usize, dice: &mut Dice) {
        for inode in &mut self.nodes {
            if let Body::File(content) = &mut inode.body {
                content.lose(dice, |of| of == host);
            }
        }
    }

    /// Number of unflushed changes that each folder keeps.
    fn kept(&self, dice: &mut Dice) -> BTreeMap<Node, usize> {
        let mut kept = BTreeMap::new();
        let mut happened = self.durable.clone();
        for (node, inode) in self.nodes.iter().enumerate() {
            if let Body::Folder(names) = &inode.body {
                let count = dice.up_to(names.unflushed.len());
                happened.extend(names.unflushed[..count].iter().map(|renamed| renamed.number));
                kept.insert(node, count);
            }
        }
        // A change of two folders is kept in both, and so are the earlier changes there.
        loop {
            let mut more = false;
            for (node, count) in &mut kept {
                let Body::Folder(names) = &self.nodes[*node].body else {
                    continue;
                };
                let last = names
                    .unflushed
                    .iter()
                    .rposition(|renamed| happened.contains(&renamed.number));
                if let Some(last) = last.filter(|last| last + 1 > *count) {
                    happened.extend(
                        names.unflushed[*count..=last]
                            .iter()
                            .map(|renamed| renamed.number),
                    );
                    (*count, more) = (last + 1, true);
                }
            }
            if !more {
                return kept;
            }
        }
    }
}

impl Content {
    /// Loses unflushed changes of the machines that `meant` selects; a random prefix of them is kept.
    fn lose(&mut self, dice: &mut Dice, meant: impl Fn(usize) -> bool) {
        let count = self
            .unflushed
            .iter()
            .filter(|written| meant(written.host))
            .count();
        if count == 0 {
            return;
        }
        let mut left = dice.up_to(count);
        self.unflushed.retain_mut(|written| {
            if !meant(written.host) {
                return true;
            }
            let stays = left > 0;
            left = left.saturating_sub(1);
            if stays && left == 0 && dice.chance(0.5) {
                written.change.tear(dice);
            }
            stays
        });
        self.bytes.clone_from(&self.durable);
        self.unflushed
            .iter()
            .for_each(|written| written.change.apply(&mut self.bytes));
    }
}

impl Names {
    fn lose(&mut self, kept: usize) {
        for renamed in self.unflushed.drain(..).take(kept) {
            renamed.apply(&mut self.durable);
        }
        self.now.clone_from(&self.durable);
    }
}

impl NameChange {
    fn apply(&self, names: &mut BTreeMap<OsString, Node>) {
        for (name, to) in &self.names {
            match to {
                Some(node) => names.insert(name.clone(), *node),
                None => names.remove(name),
            };
        }
    }
}

impl Change {
    /// Keeps a random prefix of the write.
    fn tear(&mut self, dice: &mut Dice) {
        if let Self::Write { bytes, .. } = self {
            bytes.truncate(dice.up_to(bytes.len()));
        }
    }

    fn apply(&self, file: &mut Vec<u8>) {
        match self {
            Self::Cut(length) => file.resize(*length, 0),
            Self::Write { at, bytes } => {
                file.resize(file.len().max(at + bytes.len()), 0);
                file[*at..at + bytes.len()].copy_from_slice(bytes);
            }
        }
    }
}

fn parts(path: &Path) -> impl Iterator<Item = &OsStr> {
    path.components().filter_map(|part| match part {
        Component::Normal(name) => Some(name),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(disk: &mut Disk, name: &str, bytes: &[u8]) -> Node {
        let node = disk.make(false, Duration::ZERO);
        disk.change(vec![(ROOT, name.into(), Some(node))], Duration::ZERO);
        disk.write(node, 0, bytes, 0).unwrap();
        node
    }

    fn left(disk: &Disk, name: &str) -> Option<Vec<u8>> {
        let node = disk.find(Path::new(name)).ok()?;
        Some(disk.content(node).unwrap().bytes.clone())
    }

    #[test]
    fn what_was_flushed_with_its_folder_stays_and_the_rest_is_chance() {
        let mut seen = BTreeSet::new();
        for seed in 0..200 {
            let (mut disk, mut dice) = (Disk::new(), Dice::new(seed));
            for name in ["both", "bytes", "name"] {
                let node = file(&mut disk, name, b"abcd");
                if name != "name" {
                    disk.flush(node);
                }
                if name == "both" {
                    disk.flush(ROOT);
                }
            }
            disk.lose_power(&mut dice);
            assert_eq!(left(&disk, "both").unwrap(), b"abcd");
            let bytes = left(&disk, "bytes");
            assert!(bytes.is_none() || bytes.unwrap() == b"abcd");
            seen.insert(left(&disk, "name"));
        }
        // The name alone, parts of the bytes, all of it, and nothing.
        assert_eq!(seen.len(), 6, "{seen:?}");
    }

    #[test]
    fn a_rename_between_folders_happens_in_both_or_in_neither() {
        let mut outcomes = BTreeSet::new();
        for seed in 0..200 {
            let (mut disk, mut dice) = (Disk::new(), Dice::new(seed));
            let (from, to) = (disk.make(true, Duration::ZERO), disk.make(true, Duration::ZERO));
            let given = [("from", from), ("to", to)].map(|(name, node)| (ROOT, name.into(), Some(node)));
            disk.change(given.to_vec(), Duration::ZERO);
            let node = disk.make(false, Duration::ZERO);
            disk.change(vec![(from, "a".into(), Some(node))], Duration::ZERO);
            [ROOT, from].into_iter().for_each(|node| disk.flush(node));
            disk.change(
                vec![(from, "a".into(), None), (to, "b".into(), Some(node))],
                Duration::ZERO,
            );
            if seed % 2 == 0 {
                disk.flush(to);
            }
            disk.lose_power(&mut dice);
            let there = |path: &str| disk.find(Path::new(path)).is_ok();
            assert!(there("from/a") != there("to/b"));
            assert!(there("to/b") || seed % 2 == 1);
            outcomes.insert(there("to/b"));
        }
        assert_eq!(outcomes.len(), 2);
    }

    #[test]
    fn a_machine_takes_only_what_it_did_not_flush_with_it() {
        let (mut disk, mut dice) = (Disk::new(), Dice::new(3));
        let node = file(&mut disk, "a", b"abc");
        disk.flush(node);
        disk.write(node, 3, b"def", 1).unwrap();
        disk.lose_host(0, &mut dice);
        assert_eq!(left(&disk, "a").unwrap(), b"abcdef");
        disk.lose_host(1, &mut dice);
        assert!(left(&disk, "a").unwrap().starts_with(b"abc"));
    }
}
