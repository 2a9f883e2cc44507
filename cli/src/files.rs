//! Files that a run writes: as a whole or not at all.
//!
//! What a file is replaced by is written under a name that nobody can foresee, beside it, and takes its
//! name at the end: a run that is cut short leaves the old file or none. Of a file that is replaced,
//! permissions stay; a symbolic link stays too, and the file that it leads to is replaced. Other names
//! of the same file, hard links, keep the old contents. What is there and is no regular file (a pipe, a
//! device) is written to directly.

use super::ending;
use super::failure::Failure;
use splitplane_scene::from_file::quoted_path;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Most links that lead from one to the next.
const MOST_LINKS: usize = 40;

/// Writes a file.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_together([(path.to_owned(), bytes)])
}

/// Writes files, which appear together or not at all; what is no regular file is written to before they
/// do.
pub(super) fn write_together<'a>(
    files: impl IntoIterator<Item = (PathBuf, &'a [u8])>,
) -> Result<(), Failure> {
    ending::check()?;
    let mut parts = Vec::new();
    for (path, bytes) in files {
        let failed = |error: io::Error| unwritten(&path, &error);
        if let Place::Stream = Place::of(&path).map_err(failed)? {
            // Behind what is there, where it leads to a file.
            let stream = fs::OpenOptions::new().append(true).open(&path);
            stream.and_then(|mut stream| stream.write_all(bytes)).map_err(failed)?;
            ending::kept();
            continue;
        }
        let (part, mut file) = Part::create(&path)?;
        file.write_all(bytes).map_err(failed)?;
        parts.push(part);
    }
    keep(parts)
}

fn unwritten(path: &Path, error: &io::Error) -> Failure {
    Failure::file(format!(
        "cannot write `{}`: {error}; check that the folder exists and may be written to",
        quoted_path(path)
    ))
}

/// Whether a file's name has this ending, in upper or lower case.
pub(super) fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

/// Refuses names of pictures that do not end in `.png`.
#[cfg(feature = "viewer")]
pub(super) fn check_ending(path: &Path) -> Result<(), Failure> {
    if ends_in(path, "png") {
        return Ok(());
    }
    let shown = quoted_path(path);
    Err(Failure::usage(format!("`{shown}` does not end in .png; screenshots are written as PNG")))
}

/// Whether a name leads to what takes bytes as they come, such as a pipe.
pub(super) fn is_stream(path: &Path) -> bool {
    matches!(Place::of(path), Ok(Place::Stream))
}

/// What a name leads to.
enum Place {
    /// A regular file, or nothing yet: the name behind all links.
    File(PathBuf),
    /// What takes bytes as they come, or an open file of some process.
    Stream,
}

impl Place {
    fn of(path: &Path) -> io::Result<Place> {
        if fs::metadata(path).is_ok_and(|about| !about.is_file()) {
            return Ok(Place::Stream);
        }
        let mut file = path.to_owned();
        for _ in 0..MOST_LINKS {
            // `/dev/stdout` and the like: nothing there can be replaced.
            if cfg!(unix) && (file.starts_with("/dev/fd") || file.starts_with("/proc")) {
                return Ok(Place::Stream);
            }
            match fs::read_link(&file) {
                Ok(link) => file = file.parent().unwrap_or(Path::new("")).join(link),
                // No link.
                Err(_) => return Ok(Place::File(file)),
            }
        }
        Err(io::Error::other("too many links lead from one to the next"))
    }
}

/// A folder that a run writes to. Dropped, or when the run is ended, it is gone again if the run made it
/// and nothing lies in it.
pub(super) struct Folder {
    made: Option<PathBuf>,
}

impl Folder {
    /// Makes the folder where it is not there. To be called before anything is measured: that it cannot be
    /// made is said first.
    pub(super) fn make(path: &Path) -> Result<Folder, Failure> {
        let made = (!path.exists()).then(|| path.to_owned());
        if let Some(made) = &made {
            ending::begun(made);
        }
        let folder = Folder { made };
        fs::create_dir_all(path).map_err(|error| {
            Failure::file(format!("cannot make the folder `{}`: {error}", quoted_path(path)))
        })?;
        Ok(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if let Some(made) = &self.made {
            // What the run or others have put there keeps it.
            let _ = fs::remove_dir(made);
            ending::done(made);
        }
    }
}

/// A file that is being written under another name beside its own. Dropped before it is kept, it
/// leaves nothing behind, and the old file as it was.
pub(super) struct Part {
    /// The other name; none after it was kept.
    part: Option<TempPath>,
    /// The name behind all links.
    file: PathBuf,
    /// As the user has it.
    path: PathBuf,
}

impl Part {
    /// Begins a file; what is written to the handle goes to the other name.
    pub(super) fn create(path: &Path) -> Result<(Part, fs::File), Failure> {
        let failed = |error: io::Error| unwritten(path, &error);
        let Place::File(file) = Place::of(path).map_err(failed)? else {
            return Err(failed(io::Error::other("it is not a regular file")));
        };
        let permissions = fs::metadata(&file).ok().map(|about| about.permissions());
        let made = beside(&file, |part| {
            let mut options = fs::OpenOptions::new();
            // Not what another has put there: neither a file nor a link.
            options.write(true).create_new(true);
            #[cfg(unix)]
            if let Some(permissions) = &permissions {
                use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
                // From the start no more may read it than may read the old one.
                options.mode(permissions.mode() & 0o777);
            }
            ending::begun(part);
            options.open(part).inspect_err(|_| ending::done(part))
        });
        let (handle, name) = made.map_err(failed)?.into_parts();
        let part = Part { part: Some(name), file, path: path.to_owned() };
        #[cfg(unix)]
        if let Some(permissions) = permissions {
            use std::os::unix::fs::PermissionsExt;
            let mut mode = permissions.mode() & 0o777;
            // What only the old file's group may do is not for another one.
            if !takes_group(&handle, &part.file) {
                mode &= 0o707;
            }
            handle.set_permissions(fs::Permissions::from_mode(mode)).map_err(failed)?;
        }
        Ok((part, handle))
    }

    /// Gives the file its own name. It must be whole.
    pub(super) fn keep(self) -> Result<(), Failure> {
        keep(vec![self])
    }

    fn rename(&mut self) -> io::Result<()> {
        let Some(part) = self.part.take() else { return Ok(()) };
        let name = part.to_path_buf();
        let renamed = part.persist(&self.file);
        ending::done(&name);
        // Where it failed, what it gives back removes the file.
        renamed.map_err(|error| error.error)
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if let Some(part) = self.part.take() {
            let name = part.to_path_buf();
            drop(part);
            ending::done(&name);
        }
    }
}

/// Gives a file the group of another one; whether it has it now.
#[cfg(unix)]
fn takes_group(file: &fs::File, other: &Path) -> bool {
    use std::os::unix::fs::{MetadataExt, fchown};
    let (Ok(own), Ok(other)) = (file.metadata(), fs::metadata(other)) else { return false };
    own.gid() == other.gid() || fchown(file, None, Some(other.gid())).is_ok()
}

/// Makes something under a name in the folder of a file that nobody can foresee.
fn beside<R>(
    file: &Path,
    make: impl FnMut(&Path) -> io::Result<R>,
) -> io::Result<tempfile::NamedTempFile<R>> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut name = tempfile::Builder::new();
    name.prefix("splitplane-").suffix(".part").rand_bytes(12);
    name.make_in(folder.unwrap_or(Path::new(".")), make)
}

/// Gives files their names: all or none. They must be whole.
fn keep(parts: Vec<Part>) -> Result<(), Failure> {
    keep_with(parts, |file, name| fs::hard_link(file, name))
}

/// The same where `link` gives a file a second name. Where it cannot, the old files have none of their own for a
/// moment.
fn keep_with(
    mut parts: Vec<Part>,
    link: impl Fn(&Path, &Path) -> io::Result<()>,
) -> Result<(), Failure> {
    ending::check()?;
    // From here on the run does not end before it is done.
    let _undivided = ending::undivided();
    let mut old = Vec::new();
    let several = parts.len() > 1;
    for place in 0..parts.len() {
        let part = &mut parts[place];
        // A second name of what is replaced, in case the next one fails.
        let (mut second, mut moved) = (Ok(None), false);
        if several && fs::symlink_metadata(&part.file).is_ok_and(|there| there.is_file()) {
            second = beside(&part.file, |name| match link(&part.file, name) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                    moved = true;
                    fs::rename(&part.file, name)
                }
                linked => linked,
            })
            .map(Some);
        }
        let renamed = second.map(|second| old.push(second)).and_then(|()| part.rename());
        if let Err(error) = renamed {
            let mut reason = error.to_string();
            for ((here, part), old) in parts.iter().enumerate().zip(old) {
                match old {
                    // Still there under its own name.
                    Some(_) if here == place && !moved => {}
                    Some(old) => {
                        let back = old.into_temp_path().persist(&part.file);
                        // Rather under another name than gone.
                        if let Some(Ok(name)) = back.err().map(|error| error.path.keep()) {
                            let [file, name] = [&part.file, &name].map(quoted_path);
                            reason += &format!("; what `{file}` held is in `{name}` now");
                        }
                    }
                    None if here == place => {}
                    None => drop(fs::remove_file(&part.file)),
                }
            }
            return Err(unwritten(&parts[place].path, &io::Error::other(reason)));
        }
    }
    parts.iter().for_each(|_| ending::kept());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_files_that_belong_together_none_appears_where_one_cannot() {
        let folder = tempfile::tempdir().unwrap();
        let [old, new, last] = ["old", "new", "last"].map(|name| folder.path().join(name));
        fs::write(&old, "before").unwrap();
        let begun = |path: &Path| {
            let (part, mut file) = Part::create(path).unwrap();
            file.write_all(b"now").unwrap();
            part
        };
        let parts = vec![begun(&old), begun(&new), begun(&last)];
        // What nobody can replace by a file.
        fs::create_dir(&last).unwrap();
        fs::write(last.join("in it"), "").unwrap();
        assert!(keep(parts).is_err());
        assert_eq!(fs::read(&old).unwrap(), b"before");
        assert!(!new.exists());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        // Where no file may have two names.
        let no_links = |_: &Path, _: &Path| Err(io::Error::from(io::ErrorKind::Unsupported));
        for order in [[&old, &new, &last], [&last, &old, &new], [&old, &last, &new]] {
            fs::remove_dir_all(&last).unwrap();
            let parts = order.map(|path| begun(path)).into();
            fs::create_dir(&last).unwrap();
            fs::write(last.join("in it"), "").unwrap();
            assert!(keep_with(parts, no_links).is_err());
            assert_eq!(fs::read(&old).unwrap(), b"before");
            assert!(!new.exists());
            assert!(last.join("in it").exists());
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        }
        keep_with(vec![begun(&old), begun(&new)], no_links).unwrap();
        assert_eq!([fs::read(&old).unwrap(), fs::read(&new).unwrap()], [b"now", b"now"]);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
        fs::write(&old, "before").unwrap();
        fs::remove_file(&new).unwrap();
        let parts = vec![begun(&old), begun(&new)];
        keep(parts).unwrap();
        assert_eq!([fs::read(&old).unwrap(), fs::read(&new).unwrap()], [b"now", b"now"]);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
