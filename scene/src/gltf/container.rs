//! `.glb`: JSON and bytes in one file.

use crate::mesh_file::{Located, MeshFileProblem, Place};

const JSON: &[u8] = b"JSON";
const BIN: &[u8] = b"BIN\0";

/// The JSON, and the bytes beside it; all of a file that is no `.glb` is JSON.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Located> {
    let fail = |at: usize, problem| Err((Some(Place::Byte(at as u64)), problem));
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    }
    let (Some(version), Some(length)) = (number(bytes, 4), number(bytes, 8)) else {
        return fail(bytes.len(), MeshFileProblem::CutShort("the header".into()));
    };
    if version != 2 {
        let sentence = format!("version {version} is not read; 2 is");
        return fail(4, MeshFileProblem::Wrong(sentence));
    }
    let Some(all) = bytes.get(..length as usize).filter(|all| all.len() >= 12) else {
        let (count, most) = (u64::from(length), bytes.len() as u64);
        return fail(8, MeshFileProblem::Count { what: "bytes".into(), count, most });
    };
    let (mut at, mut json, mut bin) = (12, None, None);
    while at < all.len() {
        let (Some(length), Some(kind)) = (number(all, at), all.get(at + 4..at + 8)) else {
            return fail(at, MeshFileProblem::CutShort("the header of a chunk".into()));
        };
        let start = at + 8;
        let Some(chunk) = all.get(start..).and_then(|rest| rest.get(..length as usize)) else {
            let (count, most) = (u64::from(length), (all.len() - start) as u64);
            let what = "bytes of a chunk".into();
            return fail(at, MeshFileProblem::Count { what, count, most });
        };
        match kind {
            JSON if json.is_none() => json = Some(chunk),
            BIN if bin.is_none() => bin = Some(chunk),
            // Chunks of other kinds are for others.
            _ => {}
        }
        at = start + chunk.len();
    }
    match json {
        Some(json) => Ok((json, bin)),
        None => fail(12, MeshFileProblem::Wrong("the file has no chunk of JSON".into())),
    }
}

fn number(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|four| u32::from_le_bytes(*four))
}
