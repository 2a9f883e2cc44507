use splitplane_test_support::random::Random;

use super::*;

const CELL: Aabb = Aabb { lo: [0.0; 3], hi: [8.0, 2.0, 8.0] };

/// Small triangles about a point.
fn small(count: usize, centre: [f32; 3], random: &mut Random) -> Vec<Triangle> {
    let mut corner = || centre.map(|x| x + 0.2 * ((random.unit() as f32) - 0.5));
    (0..count).map(|_| [corner(), corner(), corner()]).collect()
}

/// Two triangles that cover the cell at a height.
fn ground(y: f32) -> [Triangle; 2] {
    [
        [[-9.0, y, -9.0], [9.0, y, -9.0], [9.0, y, 9.0]],
        [[-9.0, y, -9.0], [9.0, y, 9.0], [-9.0, y, 9.0]],
    ]
}

fn groups(triangles: &[Triangle], cell: &Aabb, lanes: usize, scale: f32) -> Option<Vec<Vec<u32>>> {
    let references: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut groups = LeafGroups::new(lanes, scale);
    let several = groups.several(&references, triangles, cell);
    several.then(|| groups.groups().map(<[u32]>::to_vec).collect())
}

/// What blocks of these triangles cost, as the module says it, in `f64`.
fn cost(group: &[u32], triangles: &[Triangle], cell: &Aabb, lanes: usize) -> f64 {
    let half = |bounds: &Aabb| {
        let [x, y, z] =
            array::from_fn(|axis| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis]));
        x * y + y * z + z * x
    };
    let boxes = group.iter().map(|&t| part(cell, &Aabb::of_points(&triangles[t as usize])));
    let boxes: Vec<Aabb> = boxes.collect();
    let all = boxes.iter().fold(Aabb::EMPTY, |all, own| all.union(own));
    let flat = (0..3).any(|axis| all.lo[axis] == all.hi[axis]);
    let starts = if flat { 0.0 } else { 0.5 * boxes.iter().map(half).sum::<f64>() };
    (half(&all) + starts) * group.len().div_ceil(lanes) as f64
}

#[test]
fn ground_under_something_is_a_block_of_its_own() {
    let mut random = Random::new(3);
    for (lanes, more) in [(8, 6), (16, 6), (16, 13)] {
        for height in [0.0, 1.0, 2.0] {
            let mut triangles = small(more, [4.0, 1.3, 4.0], &mut random);
            triangles.splice(2..2, ground(height));
            let mut found = groups(&triangles, &CELL, lanes, 1.0).expect("two groups");
            found.iter_mut().for_each(|group| group.sort_unstable());
            found.sort();
            let (under, rest): (Vec<u32>, Vec<u32>) =
                (0..triangles.len() as u32).partition(|t| (2..4).contains(t));
            assert_eq!(found, [rest, under], "{lanes} {height}");
        }
    }
}

#[test]
fn what_fills_its_box_stays_together() {
    // A height field of 3 x 2 squares, two triangles each.
    let at = |x: u32, z: u32| [x as f32, 0.3 * ((x * 5 + z * 3) % 4) as f32, z as f32];
    let squares = (0..6).map(|i| (i % 3, i / 3));
    let field: Vec<Triangle> = squares
        .flat_map(|(x, z)| {
            let [a, b, c, d] = [at(x, z), at(x + 1, z), at(x + 1, z + 1), at(x, z + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    assert_eq!(groups(&field, &CELL, 16, 1.0), None);
    // All in one plane.
    assert_eq!(groups(&ground(1.0), &CELL, 8, 1.0), None);
    // One has nothing to be divided from, and too many are not looked at.
    assert_eq!(groups(&field[..1], &CELL, 8, 1.0), None);
    let crowd = small(MOST + 1, [1.0; 3], &mut Random::new(1));
    assert_eq!(groups(&crowd, &CELL, 8, 1.0), None);
}

#[test]
fn groups_have_every_triangle_once_and_cost_less() {
    let mut random = Random::new(5);
    let (mut divided, mut together, mut more) = (0, 0, 0);
    for round in 0..3_000 {
        let lanes = [8, 16][round % 2];
        let mut triangles = Vec::new();
        for _ in 0..1 + random.below(4) {
            let centre = [8.0, 2.0, 8.0].map(|size| size * (random.unit() as f32));
            let count = 1 + random.below(if round % 3 == 0 { 5 } else { 14 });
            triangles.extend(small(count, centre, &mut random));
        }
        if round % 5 == 0 {
            triangles.extend(ground(random.below(3) as f32));
        }
        let all: Vec<u32> = (0..triangles.len() as u32).collect();
        let Some(found) = groups(&triangles, &CELL, lanes, 1.0) else {
            together += 1;
            continue;
        };
        divided += 1;
        let mut flattened = found.concat();
        flattened.sort_unstable();
        assert_eq!(flattened, all);
        let of = |group: &Vec<u32>| cost(group, &triangles, &CELL, lanes);
        let (parts, whole) = (found.iter().map(of).sum::<f64>(), of(&all));
        let blocks: usize = found.iter().map(|group| group.len().div_ceil(lanes)).sum();
        let limit = if blocks > all.len().div_ceil(lanes) {
            more += 1;
            // Of several divisions only some make more blocks.
            if found.len() == 2 { f64::from(MORE_BLOCKS) } else { 1.0 }
        } else {
            1.0
        };
        assert!(parts < (limit + 1e-5) * whole, "{parts} {whole} {found:?}");
        // A power of two changes nothing, so scenes of any size are divided alike.
        let power = f32::powi(2.0, 110);
        let far = triangles.iter().map(|t| t.map(|corner| corner.map(|x| x * power)));
        let far: Vec<Triangle> = far.collect();
        let cell = Aabb { lo: CELL.lo, hi: CELL.hi.map(|x| x * power) };
        assert_eq!(groups(&far, &cell, lanes, 1.0 / power), Some(found));
    }
    assert!(divided > 500 && together > 100 && more > 300, "{divided} {together} {more}");
}
