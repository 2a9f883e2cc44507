//! A custom query: how thick the wall is that a ray comes to first.

use std::ops::ControlFlow;

use splitplane::core::exact::{ExactRay, meet};
use splitplane::core::query::traverse::Triangles;
use splitplane::{Backend, BuildOptions, CpuBackend, Culling, KdTree, Mesh, Ray};

/// From where the ray first enters a closed surface to where it first leaves one after that. `None` also where the ray starts
/// inside, since its first exit has no entry.
fn thickness(tree: &KdTree, mesh: &Mesh<'_>, ray: &Ray) -> Option<f32> {
    let exact = ExactRay::new(ray)?;
    let (mut entry, mut exit) = (f32::INFINITY, f32::INFINITY);
    tree.visit_along(ray, |leaf| {
        for &triangle in leaf.triangles {
            let corners = mesh.corners(triangle);
            match meet(&exact, &corners, Culling::None) {
                Some(met) if !met.is_within_limits() => {}
                Some(met) if met.is_front() => entry = entry.min(met.t()),
                Some(met) => exit = exit.min(met.t()),
                None => {}
            }
        }
        // Nothing behind the nearest exit matters.
        ControlFlow::Continue(f64::from(exit))
    });
    (entry < exit && exit < f32::INFINITY).then_some(exit - entry)
}

/// The twelve triangles of a cube around 0; `facing` is 1 for fronts on the outside, -1 for the inside.
fn cube(half: f32, facing: f32) -> impl Iterator<Item = [[f32; 3]; 3]> {
    (0..12).map(move |k| {
        let (axis, side, third) = (k % 3, [-1.0, 1.0][k / 3 % 2], [-1.0, 1.0][k / 6]);
        let corner = |u: f32, v: f32| {
            let mut p = [side * half; 3];
            (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (u * half, v * half);
            p
        };
        let [a, b, c] = [corner(-1.0, -1.0), corner(1.0, 1.0), corner(-third, third)];
        if side * third * facing > 0.0 { [a, b, c] } else { [a, c, b] }
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A hollow cube, 4 wide, with walls of 0.5.
    let triangles: Vec<_> = cube(2.0, 1.0).chain(cube(1.5, -1.0)).collect();
    let mesh = Mesh::soup(&triangles)?;
    let accelerator = CpuBackend::new().build(&mesh, &BuildOptions::default())?;
    for y in [0.25, 1.625, 1.75, 2.5] {
        let ray = Ray::new([-5.0, y, 0.125], [1.0, 0.0, 0.0]);
        match thickness(accelerator.tree(), &mesh, &ray) {
            Some(t) => println!("at y = {y} the wall is {t} thick"),
            None => println!("at y = {y} there is no wall"),
        }
    }
    Ok(())
}
