//! What is written has files of its own: none that the command line gives to read, nor another that it writes. Files that a scene names in
//! its text are not known here.

use super::failure::Failure;
use super::files;
use splitplane_scene::from_file::quoted_path;
use std::path::{Path, PathBuf};

/// Refuses to write over what is read, and two answers to one file. What is read may be no file, as a scene that is built in.
pub(super) fn check<'a>(
    read: impl IntoIterator<Item = &'a Path>,
    written: impl IntoIterator<Item = &'a Path>,
) -> Result<(), Failure> {
    let mut taken: Vec<(PathBuf, &str)> =
        read.into_iter().map(|path| (place(path), "is read")).collect();
    for path in written.into_iter().filter(|path| !files::is_stream(path)) {
        let own = place(path);
        if let Some((_, use_of_it)) = taken.iter().find(|(other, _)| *other == own) {
            return Err(Failure::usage(format!(
                "`{}` {use_of_it} already; give what is written a file of its own",
                quoted_path(path)
            )));
        }
        taken.push((own, "is written"));
    }
    Ok(())
}

/// Where a file is, whatever way its name goes there, as far as it exists.
fn place(path: &Path) -> PathBuf {
    std::fs::canonicalize(path)
        .or_else(|_| std::path::absolute(path))
        .unwrap_or_else(|_| path.into())
}
