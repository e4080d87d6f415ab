//! The calls of the standard library for files: on the simulated disk for a process of a simulation, otherwise on
//! the real one.

#![allow(
    missing_docs,
    clippy::len_without_is_empty,
    reason = "its calls are those of the standard library, by their names"
)]

use super::{
    disk::Node,
    machine::Machine,
    this,
    turns::{Caller, Process},
};
use std::{
    ffi::{OsStr, OsString},
    fs::{self as real, TryLockError},
    io::{self, ErrorKind, Read, Seek, SeekFrom, Write},
    panic::Location,
    path::{Path, PathBuf},
    rc::Rc,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

/// An open file, simulated or real.
#[derive(Debug)]
pub enum File {
    Real(real::File),
    Simulated(Open),
}

/// An open file of the simulated disk.
pub struct Open {
    by: Rc<Process>,
    node: Node,
    at: usize,
    appends: bool,
    path: PathBuf,
}

/// Options for opening a file.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    read: bool,
    write: bool,
    append: bool,
    truncate: bool,
    create: bool,
    create_new: bool,
}

/// Metadata of a file or folder.
#[derive(Debug, Clone)]
pub enum Metadata {
    Real(real::Metadata),
    Simulated {
        folder: bool,
        length: u64,
        changed: Duration,
    },
}

/// A name in a folder.
#[derive(Debug)]
pub struct DirEntry {
    path: PathBuf,
    kind: Metadata,
}

/// A call on the simulated disk if this thread is one of its processes, and on the real disk otherwise.
fn either<T>(
    what: &str,
    path: &Path,
    simulated: impl FnOnce(&mut Machine, &Caller) -> io::Result<T>,
    on_real: impl FnOnce() -> io::Result<T>,
) -> io::Result<T> {
    match this() {
        Some(this) => this.call(|| format!("{what} {}", path.display()), simulated),
        None => on_real(),
    }
}

pub fn read(path: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    let path = path.as_ref();
    let simulated = |machine: &mut Machine, me: &Caller| {
        let node = fresh(machine, me, path)?;
        machine.disk.content(node).map(|content| content.bytes.clone())
    };
    either("read", path, simulated, || real::read(path))
}

pub fn read_to_string(path: impl AsRef<Path>) -> io::Result<String> {
    String::from_utf8(read(path)?).map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

pub fn write(path: impl AsRef<Path>, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    File::create(path)?.write_all(bytes.as_ref())
}

pub fn copy(from: impl AsRef<Path>, to: impl AsRef<Path>) -> io::Result<u64> {
    match this() {
        None => real::copy(from, to),
        Some(_) => {
            let bytes = read(from)?;
            write(to, &bytes)?;
            Ok(bytes.len() as u64)
        }
    }
}

pub fn create_dir(path: impl AsRef<Path>) -> io::Result<()> {
    let path = path.as_ref();
    let simulated = |machine: &mut Machine, me: &Caller| {
        let (folder, name) = free(machine, path)?;
        room(machine, me)?;
        let at = machine.disk_date();
        let node = machine.disk.make(true, at);
        machine.change(me.host, vec![(folder, name, Some(node))]);
        Ok(())
    };
    either("create folder", path, simulated, || real::create_dir(path))
}

pub fn create_dir_all(path: impl AsRef<Path>) -> io::Result<()> {
    let path = path.as_ref();
    if this().is_none() {
        return real::create_dir_all(path);
    }
    let mut missing: Vec<&Path> = path
        .ancestors()
        .take_while(|folder| folder.file_name().is_some())
        .collect();
    missing.reverse();
    for folder in missing {
        match create_dir(folder) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            outcome => outcome?,
        }
    }
    Ok(())
}

pub fn remove_file(path: impl AsRef<Path>) -> io::Result<()> {
    let path = path.as_ref();
    let simulated = |machine: &mut Machine, me: &Caller| {
        let node = fresh(machine, me, path)?;
        if machine.disk.is_folder(node) {
            return Err(ErrorKind::IsADirectory.into());
        }
        let (folder, name) = machine.disk.place(path)?;
        machine.change(me.host, vec![(folder, name, None)]);
        Ok(())
    };
    either("remove", path, simulated, || real::remove_file(path))
}

pub fn remove_dir(path: impl AsRef<Path>) -> io::Result<()> {
    let path = path.as_ref();
    let simulated = |machine: &mut Machine, me: &Caller| {
        let node = fresh(machine, me, path)?;
        if !machine.disk.names(node)?.now.is_empty() {
            return Err(ErrorKind::DirectoryNotEmpty.into());
        }
        let (folder, name) = machine.disk.place(path)?;
        machine.change(me.host, vec![(folder, name, None)]);
        Ok(())
    };
    either("remove folder", path, simulated, || real::remove_dir(path))
}

pub fn remove_dir_all(path: impl AsRef<Path>) -> io::Result<()> {
    let path = path.as_ref();
    if this().is_none() {
        return real::remove_dir_all(path);
    }
    for entry in read_dir(path)? {
        let entry = entry?;
        let removed = if entry.kind.is_dir() {
            remove_dir_all(entry.path())
        } else {
            remove_file(entry.path())
        };
        // Another process may have removed it meanwhile.
        removed.or_else(|error| {
            if error.kind() == ErrorKind::NotFound {
                Ok(())
            } else {
                Err(error)
            }
        })?;
    }
    remove_dir(path)
}

pub fn rename(from: impl AsRef<Path>, to: impl AsRef<Path>) -> io::Result<()> {
    let (from, to) = (from.as_ref(), to.as_ref());
    let simulated = |machine: &mut Machine, me: &Caller| {
        let node = fresh(machine, me, from)?;
        let ((source, old), (target, new)) = (machine.disk.place(from)?, machine.disk.place(to)?);
        if let Some(there) = machine.disk.names(target)?.now.get(new).copied() {
            let (is, was) = (machine.disk.is_folder(node), machine.disk.is_folder(there));
            match (is, was) {
                (false, true) => return Err(ErrorKind::IsADirectory.into()),
                (true, false) => return Err(ErrorKind::NotADirectory.into()),
                (true, true) if !machine.disk.names(there)?.now.is_empty() => {
                    return Err(ErrorKind::DirectoryNotEmpty.into());
                }
                _ => {}
            }
        }
        machine.change(me.host, vec![(source, old, None), (target, new, Some(node))]);
        Ok(())
    };
    either("rename to", to, simulated, || real::rename(from, to))
}

pub fn hard_link(from: impl AsRef<Path>, to: impl AsRef<Path>) -> io::Result<()> {
    let (from, to) = (from.as_ref(), to.as_ref());
    let simulated = |machine: &mut Machine, me: &Caller| {
        let node = fresh(machine, me, from)?;
        let (folder, name) = free(machine, to)?;
        machine.change(me.host, vec![(folder, name, Some(node))]);
        Ok(())
    };
    either("link", to, simulated, || real::hard_link(from, to))
}

pub fn metadata(path: impl AsRef<Path>) -> io::Result<Metadata> {
    let path = path.as_ref();
    either(
        "look at",
        path,
        |machine, me| look(machine, me, path),
        || real::metadata(path).map(Metadata::Real),
    )
}

pub fn symlink_metadata(path: impl AsRef<Path>) -> io::Result<Metadata> {
    let path = path.as_ref();
    either(
        "look at",
        path,
        |machine, me| look(machine, me, path),
        || real::symlink_metadata(path).map(Metadata::Real),
    )
}

fn look(machine: &mut Machine, me: &Caller, path: &Path) -> io::Result<Metadata> {
    let node = machine.find(me.host, path, me.quiet)?;
    Ok(known(machine, node))
}

fn known(machine: &Machine, node: Node) -> Metadata {
    Metadata::Simulated {
        folder: machine.disk.is_folder(node),
        length: machine
            .disk
            .content(node)
            .map_or(0, |content| content.bytes.len() as u64),
        changed: machine.disk.node(node).changed,
    }
}

pub fn read_link(path: impl AsRef<Path>) -> io::Result<PathBuf> {
    let path = path.as_ref();
    either(
        "read link",
        path,
        |_, _| Err(ErrorKind::InvalidInput.into()),
        || real::read_link(path),
    )
}

pub fn canonicalize(path: impl AsRef<Path>) -> io::Result<PathBuf> {
    let path = path.as_ref();
    either(
        "find",
        path,
        |_, _| Ok(path.to_owned()),
        || real::canonicalize(path),
    )
}

pub fn read_dir(path: impl AsRef<Path>) -> io::Result<std::vec::IntoIter<io::Result<DirEntry>>> {
    let path = path.as_ref();
    let simulated = |machine: &mut Machine, me: &Caller| {
        let folder = machine.disk.find(path)?;
        let names = machine.seen(me.host, folder, me.quiet)?;
        let entry = |(name, node): (OsString, Node)| {
            Ok(DirEntry {
                path: path.join(name),
                kind: known(machine, node),
            })
        };
        Ok(names.into_iter().map(entry).collect::<Vec<_>>())
    };
    let on_real = || {
        let entry = |entry: io::Result<real::DirEntry>| {
            let path = entry?.path();
            let kind = Metadata::Real(real::symlink_metadata(&path)?);
            Ok(DirEntry { path, kind })
        };
        Ok(real::read_dir(path)?.map(entry).collect())
    };
    Ok(either("list", path, simulated, on_real)?.into_iter())
}

/// The object of a path for a call that asks the disk itself; names that a machine remembers as missing stay missing.
fn fresh(machine: &mut Machine, me: &Caller, path: &Path) -> io::Result<Node> {
    machine.find(me.host, path, me.quiet)?;
    machine.disk.find(path)
}

/// The folder and name for a new entry that may not exist yet.
fn free<'a>(machine: &Machine, path: &'a Path) -> io::Result<(Node, &'a OsStr)> {
    let (folder, name) = machine.disk.place(path)?;
    if machine.disk.names(folder)?.now.contains_key(name) {
        return Err(ErrorKind::AlreadyExists.into());
    }
    Ok((folder, name))
}

fn room(machine: &Machine, me: &Caller) -> io::Result<()> {
    if machine.is_full() && !me.quiet {
        return Err(ErrorKind::StorageFull.into());
    }
    Ok(())
}

impl DirEntry {
    pub fn path(&self) -> PathBuf {
        self.path.clone()
    }

    pub fn file_name(&self) -> OsString {
        self.path.file_name().map(OsStr::to_owned).unwrap_or_default()
    }

    pub fn file_type(&self) -> io::Result<Metadata> {
        Ok(self.kind.clone())
    }
}

impl Metadata {
    pub fn is_file(&self) -> bool {
        match self {
            Self::Real(data) => data.is_file(),
            Self::Simulated { folder, .. } => !folder,
        }
    }

    pub fn is_dir(&self) -> bool {
        match self {
            Self::Real(data) => data.is_dir(),
            Self::Simulated { folder, .. } => *folder,
        }
    }

    pub fn is_symlink(&self) -> bool {
        matches!(self, Self::Real(data) if data.is_symlink())
    }

    pub fn len(&self) -> u64 {
        match self {
            Self::Real(data) => data.len(),
            Self::Simulated { length, .. } => *length,
        }
    }

    pub fn modified(&self) -> io::Result<SystemTime> {
        match self {
            Self::Real(data) => data.modified(),
            Self::Simulated { changed, .. } => Ok(UNIX_EPOCH + *changed),
        }
    }
}

impl OpenOptions {
    pub fn new() -> Self {
        Self::default()
    }

    pub fn read(&mut self, yes: bool) -> &mut Self {
        self.read = yes;
        self
    }

    pub fn write(&mut self, yes: bool) -> &mut Self {
        self.write = yes;
        self
    }

    pub fn append(&mut self, yes: bool) -> &mut Self {
        self.append = yes;
        self
    }

    pub fn create(&mut self, yes: bool) -> &mut Self {
        self.create = yes;
        self
    }

    pub fn open(&self, path: impl AsRef<Path>) -> io::Result<File> {
        let path = path.as_ref();
        let Some(by) = this() else {
            return self.open_real(path).map(File::Real);
        };
        let node = by.call(
            || format!("open {}", path.display()),
            |machine, me| self.open_simulated(machine, me, path),
        )?;
        Ok(File::Simulated(Open {
            by,
            node,
            at: 0,
            appends: self.append,
            path: path.to_owned(),
        }))
    }

    fn open_real(&self, path: &Path) -> io::Result<real::File> {
        real::OpenOptions::new()
            .read(self.read)
            .write(self.write)
            .append(self.append)
            .truncate(self.truncate)
            .create(self.create)
            .create_new(self.create_new)
            .open(path)
    }

    fn open_simulated(&self, machine: &mut Machine, me: &Caller, path: &Path) -> io::Result<Node> {
        if !self.create && !self.create_new {
            return fresh(machine, me, path);
        }
        let (folder, name) = machine.disk.place(path)?;
        let node = match machine.disk.names(folder)?.now.get(name).copied() {
            Some(_) if self.create_new => return Err(ErrorKind::AlreadyExists.into()),
            Some(node) => node,
            None => {
                room(machine, me)?;
                let at = machine.disk_date();
                let node = machine.disk.make(false, at);
                machine.change(me.host, vec![(folder, name, Some(node))]);
                node
            }
        };
        if self.truncate {
            machine.disk.cut(node, 0, me.host)?;
        }
        Ok(node)
    }
}

impl File {
    pub fn open(path: impl AsRef<Path>) -> io::Result<Self> {
        OpenOptions::new().read(true).open(path)
    }

    pub fn create(path: impl AsRef<Path>) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        (options.write, options.create, options.truncate) = (true, true, true);
        options.open(path)
    }

    pub fn create_new(path: impl AsRef<Path>) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        (options.write, options.create_new) = (true, true);
        options.open(path)
    }

    pub fn options() -> OpenOptions {
        OpenOptions::new()
    }

    #[track_caller]
    pub fn sync_all(&self) -> io::Result<()> {
        let place = Location::caller();
        match self {
            Self::Real(file) => file.sync_all(),
            Self::Simulated(open) => open.flush_at(place),
        }
    }

    #[track_caller]
    pub fn sync_data(&self) -> io::Result<()> {
        let place = Location::caller();
        match self {
            Self::Real(file) => file.sync_data(),
            Self::Simulated(open) => open.flush_at(place),
        }
    }

    pub fn set_len(&self, length: u64) -> io::Result<()> {
        match self {
            Self::Real(file) => file.set_len(length),
            Self::Simulated(open) => open.call("cut", |machine, me| {
                machine
                    .disk
                    .cut(open.node, usize::try_from(length).unwrap(), me.host)
            }),
        }
    }

    pub fn metadata(&self) -> io::Result<Metadata> {
        match self {
            Self::Real(file) => file.metadata().map(Metadata::Real),
            Self::Simulated(open) => open.call("look at", |machine, _| Ok(known(machine, open.node))),
        }
    }

    pub fn try_lock(&self) -> Result<(), TryLockError> {
        match self {
            Self::Real(file) => file.try_lock(),
            Self::Simulated(open) => {
                let taken = open.call("lock", |machine, me| {
                    Ok(*machine.locks.entry(open.node).or_insert(me.at) == me.at)
                });
                match taken {
                    Ok(true) => Ok(()),
                    Ok(false) => Err(TryLockError::WouldBlock),
                    Err(error) => Err(TryLockError::Error(error)),
                }
            }
        }
    }
}

impl Open {
    fn call<T>(&self, what: &str, act: impl FnOnce(&mut Machine, &Caller) -> io::Result<T>) -> io::Result<T> {
        self.by.call(|| format!("{what} {}", self.path.display()), act)
    }

    fn flush_at(&self, place: &Location<'_>) -> io::Result<()> {
        let place = format!("{}:{}", place.file(), place.line());
        self.call("flush", |machine, _| {
            machine.flushed.insert(place.clone());
            if machine.without_flush.as_ref() != Some(&place) {
                machine.disk.flush(self.node);
            }
            Ok(())
        })
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        let _ = self.call("close", |machine, me| {
            machine
                .locks
                .retain(|node, holder| (*node, *holder) != (self.node, me.at));
            Ok(())
        });
    }
}

impl std::fmt::Debug for Open {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}", self.path.display())
    }
}

impl From<File> for std::process::Stdio {
    fn from(file: File) -> Self {
        match file {
            File::Real(file) => file.into(),
            File::Simulated(_) => Self::null(),
        }
    }
}

impl Read for File {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Real(file) => file.read(buffer),
            Self::Simulated(open) => {
                let (node, at) = (open.node, open.at);
                let count = open.call("read", |machine, _| {
                    let bytes = &machine.disk.content(node)?.bytes;
                    let rest = bytes.get(at..).unwrap_or_default();
                    let count = rest.len().min(buffer.len());
                    buffer[..count].copy_from_slice(&rest[..count]);
                    Ok(count)
                })?;
                open.at += count;
                Ok(count)
            }
        }
    }
}

impl Write for File {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Real(file) => file.write(bytes),
            Self::Simulated(open) => {
                let (node, mut at, appends) = (open.node, open.at, open.appends);
                open.call("write", |machine, me| {
                    room(machine, me)?;
                    if appends {
                        at = machine.disk.content(node)?.bytes.len();
                    }
                    let changed = machine.disk_date();
                    machine.disk.touch(node, changed);
                    machine.disk.write(node, at, bytes, me.host)
                })?;
                open.at = at + bytes.len();
                Ok(bytes.len())
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Real(file) => file.flush(),
            Self::Simulated(_) => Ok(()),
        }
    }
}

impl Seek for File {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Real(file) => file.seek(to),
            Self::Simulated(open) => {
                open.at = match to {
                    SeekFrom::Start(at) => usize::try_from(at).map_err(io::Error::other)?,
                    SeekFrom::End(0) => {
                        let node = open.node;
                        open.call("measure", |machine, _| {
                            Ok(machine.disk.content(node)?.bytes.len())
                        })?
                    }
                    _ => return Err(ErrorKind::Unsupported.into()),
                };
                Ok(open.at as u64)
            }
        }
    }
}
