//! The files that OBJ and .mtl files name: where they are.

use std::path::{Path, PathBuf};

/// The regular file that a name of a file means, seen from a folder: as written, or with the
/// slashes of another system.
pub(super) fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let written = folder.join(name);
    if written.is_file() {
        return Some(written);
    }
    let turned = folder.join(name.replace('\\', "/"));
    turned.is_file().then_some(turned)
}
