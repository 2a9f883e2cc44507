//! Scenes as users name them, and those that stand in for the survey's.

use std::ffi::{OsStr, OsString};
use std::str::FromStr;
use thiserror::Error;

/// A scene, and how many lights it is to have: `SCENE` or `SCENE@LIGHTS`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    /// The path of an .obj file, or `builtin:NAME[:SIZE]`.
    pub spec: OsString,
    /// Lights it is to have: its own if it brings as many, else placed; its own, or one, when left out.
    pub lights: Option<usize>,
}

/// Built-in scenes of the survey's sizes, with as many lights.
pub const STAND_INS: [&str; 6] = [
    "builtin:carousel:11000@1",
    "builtin:city:27000@2",
    "builtin:carousel:71000@3",
    "builtin:city:111000@6",
    "builtin:carousel:178000@2",
    "builtin:city:252000@1",
];

/// A number of lights that no scene can be given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a scene can be given 1 to 8 lights, not {0}")]
pub struct BadLights(u64);

impl FromStr for Asked {
    type Err = BadLights;

    fn from_str(text: &str) -> Result<Asked, BadLights> {
        Asked::of(OsStr::new(text))
    }
}

impl Asked {
    /// A scene whose path need not be UTF-8.
    ///
    /// # Errors
    /// [`BadLights`].
    pub fn of(text: &OsStr) -> Result<Asked, BadLights> {
        let whole = Asked { spec: text.to_owned(), lights: None };
        let bytes = text.as_encoded_bytes();
        let at = bytes.iter().rposition(|byte| *byte == b'@');
        // Digits at the end are text, whatever stands before them.
        let Some((spec, lights)) = at.and_then(|at| {
            let lights = std::str::from_utf8(&bytes[at + 1..]).ok()?;
            Some((start(text, at)?, lights))
        }) else {
            return Ok(whole);
        };
        match lights.parse() {
            Ok(lights @ 1..=8) => Ok(Asked { spec, lights: Some(lights as usize) }),
            Ok(lights) => Err(BadLights(lights)),
            // A name with an @ in it.
            Err(_) => Ok(whole),
        }
    }
}

/// The text before a byte that is a letter of its own.
fn start(text: &OsStr, end: usize) -> Option<OsString> {
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        Some(OsStr::from_bytes(text.as_bytes().get(..end)?).to_owned())
    }
    #[cfg(not(unix))]
    text.to_str()?.get(..end).map(OsString::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_path_need_not_be_utf8() {
        use std::os::unix::ffi::OsStrExt;
        let spec = |bytes| OsStr::from_bytes(bytes).to_owned();
        let asked = Asked::of(&spec(b"\xff/a.obj@2")).unwrap();
        assert_eq!((asked.spec, asked.lights), (spec(b"\xff/a.obj"), Some(2)));
        let asked = Asked::of(&spec(b"a@\xff.obj")).unwrap();
        assert_eq!((asked.spec, asked.lights), (spec(b"a@\xff.obj"), None));
    }

    #[test]
    fn lights_stand_behind_a_scene() {
        let of = |text: &str| text.parse().map(|Asked { spec, lights }| (spec, lights));
        assert_eq!(of("a.obj"), Ok(("a.obj".into(), None)));
        assert_eq!(of("a.obj@3"), Ok(("a.obj".into(), Some(3))));
        assert_eq!(of("me@home/a.obj"), Ok(("me@home/a.obj".into(), None)));
        assert_eq!((of("a.obj@0"), of("a.obj@9")), (Err(BadLights(0)), Err(BadLights(9))));
    }

    #[test]
    fn stand_ins_have_the_printed_sizes_and_lights() {
        for (text, printed) in STAND_INS.iter().zip(&crate::paper::survey::SCENES) {
            let asked: Asked = text.parse().unwrap();
            assert_eq!(asked.lights, Some(printed.lights as usize));
            let spec = asked.spec.to_str().unwrap();
            let size: f64 = spec.rsplit_once(':').unwrap().1.parse().unwrap();
            assert_eq!(size, 1e3 * f64::from(printed.kilo_triangles));
        }
    }
}
