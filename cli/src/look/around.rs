//! Lights and what is around a scene, as users write them.

use crate::files::ends_in;
use crate::options::point;
use splitplane::render::Environment;
use std::path::PathBuf;

/// A place or direction, and perhaps a colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    pub(super) place: [f32; 3],
    pub(super) irradiance: Option<[f32; 3]>,
}

/// `x,y,z` or `x,y,z,r,g,b`.
pub(super) fn lamp(text: &str) -> Result<Lamp, String> {
    let wrong =
        || "give three or six finite numbers, such as 1,2.5,-3 or 1,2,3,0.5,0.5,1".to_owned();
    let parts: Vec<&str> = text.split(',').collect();
    let irradiance = match parts.len() {
        3 => None,
        6 => Some(point(&parts[3..].join(",")).map_err(|_| wrong())?),
        _ => return Err(wrong()),
    };
    if irradiance.is_some_and(|colour| colour.iter().any(|part| *part < 0.0)) {
        return Err("the irradiance of a light cannot be negative".to_owned());
    }
    Ok(Lamp { place: point(&parts[..3].join(",")).map_err(|_| wrong())?, irradiance })
}

/// What is around a scene.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Surroundings {
    Colours(Environment),
    File(PathBuf),
}

/// `sky`, `black`, one radiance for all directions, or the path of a picture.
pub(super) fn environment(text: &str) -> Result<Surroundings, String> {
    let path = PathBuf::from(text);
    match text {
        "sky" => Ok(Surroundings::Colours(Environment::SKY)),
        "black" => Ok(Surroundings::Colours(Environment::BLACK)),
        _ if ends_in(&path, "hdr") || ends_in(&path, "exr") => Ok(Surroundings::File(path)),
        _ => match point(text) {
            Ok(radiance) => Ok(Surroundings::Colours(Environment::uniform(radiance))),
            Err(_) => Err("give `sky`, `black`, three numbers, such as 0.5,0.5,0.6, or the path of a .hdr or .exr"
                .to_owned()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lamps_have_a_place_and_may_have_a_colour() {
        assert_eq!(lamp("1,2,3").unwrap().place, [1.0, 2.0, 3.0]);
        assert_eq!(lamp("1,2,3,4,5,6").unwrap().irradiance, Some([4.0, 5.0, 6.0]));
        for bad in ["1,2", "1,2,3,4", "a,b,c", "1,2,3,-1,0,0", "1,2,3,4,5,nan"] {
            assert!(lamp(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn environments() {
        let colours = |text| match environment(text) {
            Ok(Surroundings::Colours(environment)) => environment,
            other => panic!("{other:?}"),
        };
        assert_eq!(colours("black"), Environment::BLACK);
        assert_eq!(colours("1,1,1"), Environment::uniform([1.0; 3]));
        let file = Surroundings::File("a/b.HDR".into());
        assert_eq!(environment("a/b.HDR"), Ok(file));
        assert!(environment("red").is_err());
    }
}
