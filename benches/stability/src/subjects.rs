//! Meshes by name.

use splitplane::scene::Scene as File;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::stability::Subject;

/// The mesh of a name.
///
/// # Errors
/// No such mesh, in words.
pub(crate) fn open(name: &str) -> Result<Subject, String> {
    let (kind, rest) = name.split_once(':').unwrap_or((name, ""));
    let unit = Some(([0.0; 3], 0.5));
    let subject = match kind {
        "sphere" => {
            let rings = match rest {
                "" => scenes::LARGE_SPHERE,
                given => given
                    .parse()
                    .ok()
                    .filter(|rings| (4..=2000).contains(rings))
                    .ok_or("sphere:RINGS has from 4 to 2000 rings")?,
            };
            Subject::new(scenes::sphere(rings, [0.0; 3], 2.0), Some(([0.0; 3], 1.0)))
        }
        "nested" => Subject::new(scenes::nested_spheres(), Some(([0.25, -0.5, 0.125], 1.0))),
        "seams" => Subject::new(scenes::seams(false), unit),
        "seams-oblique" => Subject::new(scenes::seams(true), Some(([3.3, -1.7, 0.9], 0.5))),
        "boxes" => Subject::new(scenes::grid_boxes(6), Some(([3.0; 3], 2.5))),
        "awkward" => {
            let mut found = scenes::awkward().into_iter().filter(|scene| scene.name == rest);
            let scene = found.next().ok_or_else(|| {
                let names: Vec<String> = scenes::awkward().into_iter().map(|s| s.name).collect();
                format!("no awkward scene `{rest}`; there are {}", names.join(", "))
            })?;
            Subject::new(scene, None)
        }
        _ => {
            let file = File::open(name).map_err(|error| error.to_string())?;
            let named = if kind == "builtin" { name } else { &file.name };
            let indices = Some(file.indices.clone());
            let positions = file.positions.clone();
            Subject::new(Scene { name: named.into(), positions, indices }, None)
        }
    };
    let kept = if kind == "builtin" || subject.ball.is_none() {
        subject.scene.name.clone()
    } else {
        name.into()
    };
    Ok(Subject { scene: subject.scene.named(&kept), ..subject })
}
