//! The bytes of buffers, and views of them.

use super::uri::{self, Source};
use super::{EXPANSION, MISSING, at, wrong};
use crate::from_file;
use crate::mesh_file::{Located, MeshFileProblem};
use gltf_json::{Index, Root, buffer};
use std::borrow::Cow;
use std::path::Path;

/// Bytes that numbers may be decoded to whatever the size of the files.
const SMALL: u64 = 64 << 20;
/// Most elements of all accessors that have no bytes and so are zero.
const ZEROS: u64 = 1 << 22;

/// The buffers of a file.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    bytes: Vec<Cow<'a, [u8]>>,
    /// Bytes that may be decoded to yet.
    budget: u64,
    zeros: u64,
}

impl<'a> Buffers<'a> {
    /// Loads all buffers. `own` are the bytes of the file; all files together may have `limit`.
    pub(super) fn load(
        root: &'a Root,
        bin: Option<&'a [u8]>,
        own: u64,
        folder: &Path,
        limit: u64,
    ) -> Result<Buffers<'a>, Located> {
        let mut left = limit.saturating_sub(own);
        let mut all = own;
        let mut bytes = Vec::new();
        for (index, buffer) in root.buffers.iter().enumerate() {
            let field = |name: &str| format!("buffers[{index}].{name}");
            let mut own: Cow<'a, [u8]> = match (&buffer.uri, bin) {
                (Some(uri), _) => {
                    match uri::resolve(uri, folder).map_err(|why| wrong(field("uri"), why))? {
                        Source::Bytes(bytes) => bytes.into(),
                        Source::File(path) => {
                            let read = from_file::read(&path, left).map_err(|error| {
                                at(field("uri"), MeshFileProblem::of_read(&error, &path))
                            })?;
                            left -= read.len() as u64;
                            all += read.len() as u64;
                            read.into()
                        }
                    }
                }
                (None, Some(bin)) if index == 0 => bin.into(),
                (None, _) => return Err(wrong(field("uri"), "the buffer has no bytes")),
            };
            let (count, most) = (buffer.byte_length.0, own.len() as u64);
            if count > most {
                let what = "bytes of a buffer".to_owned();
                return Err(at(field("byteLength"), MeshFileProblem::Count { what, count, most }));
            }
            match &mut own {
                Cow::Borrowed(bytes) => *bytes = &bytes[..count as usize],
                Cow::Owned(bytes) => bytes.truncate(count as usize),
            }
            bytes.push(own);
        }
        let budget = SMALL.saturating_add(all.saturating_mul(EXPANSION));
        Ok(Buffers { root, bytes, budget, zeros: ZEROS })
    }

    /// The bytes of a view.
    pub(super) fn view(&self, index: Index<buffer::View>) -> Result<&[u8], Located> {
        let field = |name: &str| format!("bufferViews[{}]{name}", index.value());
        let view = self.root.buffer_views.get(index.value());
        let view = view.ok_or_else(|| wrong(field(""), MISSING))?;
        let bytes = self.bytes.get(view.buffer.value());
        let bytes = bytes.ok_or_else(|| wrong(field(".buffer"), MISSING))?;
        let (start, count) = (view.byte_offset.unwrap_or_default().0, view.byte_length.0);
        let most = (bytes.len() as u64).saturating_sub(start);
        if count > most {
            let what = "bytes of a view".to_owned();
            return Err(at(field(".byteLength"), MeshFileProblem::Count { what, count, most }));
        }
        // Both are within the buffer: none of them is larger than memory. An empty view may start anywhere.
        Ok(bytes.get(start as usize..).map_or(&[], |rest| &rest[..count as usize]))
    }

    /// Refuses to decode more than the files warrant.
    pub(super) fn spend(&mut self, bytes: u64, field: impl Fn() -> String) -> Result<(), Located> {
        let left = self.budget.checked_sub(bytes);
        self.budget = left.ok_or_else(|| {
            let sentence =
                format!("the numbers of the file take more than {EXPANSION} times its bytes");
            wrong(field(), sentence)
        })?;
        Ok(())
    }

    /// Refuses too many numbers without bytes.
    pub(super) fn spend_zeros(
        &mut self,
        count: u64,
        field: impl Fn() -> String,
    ) -> Result<(), Located> {
        let left = self.zeros.checked_sub(count);
        self.zeros = left.ok_or_else(|| {
            let (what, most) = ("elements of accessors without bytes".to_owned(), ZEROS);
            at(field(), MeshFileProblem::Count { what, count, most })
        })?;
        Ok(())
    }

    pub(super) fn root(&self) -> &'a Root {
        self.root
    }
}
