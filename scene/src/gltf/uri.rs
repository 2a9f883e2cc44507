//! What URIs mean: bytes within them, or files in the folder of the file.

use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// Standard letters, with or without what fills up the end.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Where the bytes are.
pub(super) enum Source {
    Bytes(Vec<u8>),
    File(PathBuf),
}

/// Resolves a URI, seen from a folder. Nothing outside the folder is named by what this gives.
pub(super) fn resolve(uri: &str, folder: &Path) -> Result<Source, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, data) = data.split_once(',').ok_or("the data URI has no comma")?;
        if !kind.ends_with(";base64") {
            return Err("the data URI is not in base64".to_owned());
        }
        let decoded = BASE64.decode(data);
        return decoded.map(Source::Bytes).map_err(|error| format!("base64: {error}"));
    }
    let name = decoded(uri);
    let path = Path::new(&*name);
    let stays =
        path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    // Drives and schemes; separators of another system.
    if name.contains([':', '\\', '\0']) || !stays || name.is_empty() {
        return Err("it leads out of the folder of the file, or is no relative path".to_owned());
    }
    let path = folder.join(path);
    let is_below = |path: &Path| {
        let home = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        // Links may lead anywhere.
        Some(path.canonicalize().ok()?.starts_with(home.canonicalize().ok()?))
    };
    match is_below(&path) {
        Some(true) => Ok(Source::File(path)),
        Some(false) => Err("a link leads out of the folder of the file".to_owned()),
        None => Err("there is no such file".to_owned()),
    }
}

/// The text with `%20` and the like as the letters that they stand for.
fn decoded(uri: &str) -> Cow<'_, str> {
    if !uri.contains('%') {
        return uri.into();
    }
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let hex = bytes.get(at + 1..at + 3).filter(|_| bytes[at] == b'%');
        let hex = hex.filter(|hex| hex.iter().all(u8::is_ascii_hexdigit));
        let value = hex.and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        out.push(value.unwrap_or(bytes[at]));
        at += if value.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_leads_out_of_the_folder() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("a b");
        std::fs::create_dir_all(folder.join("in")).unwrap();
        std::fs::write(home.path().join("out.bin"), "secret").unwrap();
        std::fs::write(folder.join("in/\u{e9} 1.bin"), "x").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink("../out.bin", folder.join("link.bin")).unwrap();
        let outside = home.path().join("out.bin").to_string_lossy().into_owned();
        for bad in [
            "../out.bin",
            "in/../../out.bin",
            "%2e%2e/out.bin",
            "..%2fout.bin",
            "..\\out.bin",
            &outside,
            "/etc/passwd",
            "file:///etc/passwd",
            "http://example.com/a.bin",
            "C:out.bin",
            "",
            "link.bin",
            "none.bin",
            "a\0b",
            "%00",
        ] {
            assert!(resolve(bad, &folder).is_err(), "{bad}");
        }
        for good in ["in/\u{e9} 1.bin", "./in/%C3%A9%201.bin", "in/%c3%a9 1.bin"] {
            assert!(matches!(resolve(good, &folder), Ok(Source::File(_))), "{good}");
        }
    }

    #[test]
    fn data_in_base64() {
        let bytes = |uri| match resolve(uri, Path::new("")) {
            Ok(Source::Bytes(bytes)) => Some(bytes),
            _ => None,
        };
        assert_eq!(bytes("data:application/octet-stream;base64,AAECAw=="), Some(vec![0, 1, 2, 3]));
        assert_eq!(bytes("data:;base64,AAECAw"), Some(vec![0, 1, 2, 3]));
        for bad in ["data:", "data:,AAEC", "data:;base64,?", "data:;base64,A"] {
            assert_eq!(bytes(bad), None, "{bad}");
        }
    }
}
