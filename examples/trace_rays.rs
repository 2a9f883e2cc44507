//! Traces rays against a few triangles: one ray, then a batch.

use splitplane::{Backend, BuildOptions, CpuBackend, Hit, Mesh, QueryOptions, Ray};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A square in the plane z = 0, and a smaller triangle behind it.
    let positions = [
        [0.0, 0.0, 0.0],
        [4.0, 0.0, 0.0],
        [4.0, 4.0, 0.0],
        [0.0, 4.0, 0.0],
        [3.0, 3.0, -2.0],
        [6.0, 3.0, -2.0],
        [3.0, 6.0, -2.0],
    ];
    let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6]];
    let mesh = Mesh::indexed(&positions, &triangles)?;
    let tree = CpuBackend::new().build(&mesh, &BuildOptions::default())?;

    // One ray at a time gives an Option.
    let options = QueryOptions::default();
    let ray = Ray::new([1.0, 2.0, 5.0], [0.0, 0.0, -1.0]);
    println!("one ray: {:?}", tree.closest_hit(&ray, &options));

    // Batches are faster: the backend spreads them over cores and has many under way.
    let rays: Vec<Ray> =
        (0..8u8).map(|x| Ray::new([f32::from(x), 3.5, 5.0], [0.0, 0.0, -1.0])).collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    tree.closest_hits(&rays, &mut hits, &options)?;
    for (ray, hit) in rays.iter().zip(&hits) {
        match hit.some() {
            Some(hit) => println!("x = {}: triangle {} at {}", ray.origin[0], hit.triangle, hit.t),
            None => println!("x = {}: nothing", ray.origin[0]),
        }
    }

    // Whether anything is in between is a cheaper question.
    let blocked = tree.any_hit(&Ray::segment([1.0, 1.0, 1.0], [1.0, 1.0, -1.0]), &options);
    println!("the segment is {}", if blocked { "blocked" } else { "free" });
    Ok(())
}
