//! Files that a report consists of, before they are written.

/// A file of the report, by its name without a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Its name.
    pub name: String,
    /// All of it.
    pub bytes: Vec<u8>,
}
