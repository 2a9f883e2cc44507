//! Switches the backend at run time and compares what each gives:
//! `cargo run --example switch_backend`, or `cargo run --example switch_backend -- cpu wgpu`.

use splitplane::{BackendKind, BuildOptions, Digest, Hit, Mesh, QueryOptions, Ray};

/// Squares of the ground on a side.
const SIDE: u32 = 48;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let kinds = match names.is_empty() {
        true => BackendKind::ALL.to_vec(),
        false => names.iter().map(|name| name.parse()).collect::<Result<Vec<BackendKind>, _>>()?,
    };
    let (positions, triangles) = hills();
    let mesh = Mesh::indexed(&positions, &triangles)?;
    let rays = rays();

    let mut first: Option<(BackendKind, Digest, Vec<Hit>)> = None;
    for kind in kinds {
        // Asking for a GPU where there is none is an error, never a silent run on the CPU.
        let opened = match kind.open() {
            Ok(opened) => opened,
            Err(error) => {
                println!("{kind}: left out, {error}");
                continue;
            }
        };
        let info = opened.backend.describe();
        println!("{kind}: {} ({})", info.name, opened.reason);

        // From here on nothing depends on which backend it is; nor do the answers.
        let tree = opened.backend.build(&mesh, &BuildOptions::default())?;
        let mut hits = vec![Hit::MISS; rays.len()];
        tree.closest_hits(&rays, &mut hits, &QueryOptions::default())?;
        let digest = tree.tree().digest();
        let hit = hits.iter().filter(|hit| hit.is_hit()).count();
        println!("  digest {digest}, {hit} of {} rays hit", rays.len());

        match &first {
            None => first = Some((kind, digest, hits)),
            Some((other, expected, expected_hits)) => {
                // As bytes, so that every bit counts.
                let [a, b] =
                    [&hits, expected_hits].map(|hits| bytemuck::cast_slice::<Hit, u8>(hits));
                if digest != *expected || a != b {
                    return Err(format!("{kind} and {other} differ").into());
                }
                println!("  the same tree and the same hits as {other}, bit for bit");
            }
        }
    }
    Ok(())
}

/// A ground with hills: any heights will do.
fn hills() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let row = SIDE + 1;
    let height = |x: u32, z: u32| ((x * x + 3 * z * z + 5 * x * z) % 17) as f32 / 8.0;
    let positions = (0..row * row)
        .map(|i| [(i % row) as f32, height(i % row, i / row), (i / row) as f32])
        .collect();
    let triangles = (0..SIDE * SIDE)
        .flat_map(|i| {
            let a = i / SIDE * row + i % SIDE;
            [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]]
        })
        .collect();
    (positions, triangles)
}

/// Rays from above the middle, some of them past the ground and many at its edges and corners.
fn rays() -> Vec<Ray> {
    let origin = [SIDE as f32 / 2.0, 12.0, SIDE as f32 / 2.0];
    let reach = SIDE + 10;
    (0..4 * reach * reach)
        .map(|i| {
            let [x, z] = [i % (2 * reach), i / (2 * reach)].map(|k| 0.5 * k as f32 - 5.0);
            Ray::new(origin, [x - origin[0], -origin[1], z - origin[2]])
        })
        .collect()
}
