use super::*;
use crate::build::sweep::oracle;
use crate::simd::f32x16::ArrayF32x16;
use splitplane_test_support::random::Random;

#[test]
fn the_split_is_that_of_a_search_over_all() {
    let mut random = Random::new(77);
    let mut small = Small::default();
    let (mut found, mut rare) = (0, 0);
    for round in 0..4000 {
        let both = oracle::costs(&mut random);
        let costs = &both[round % 2];
        let count = 1 + random.below(if round % 8 == 0 { MOST } else { 40 });
        let (cell, references) = oracle::node(&mut random, costs, count);
        if cell.area <= 0.0 {
            continue;
        }
        let free = oracle::best_split(costs, &cell, &references, f64::INFINITY);
        let mut limits = vec![f64::INFINITY, costs.leaf(cell.area, count as u32)];
        limits.extend(free.map(|split| split.cost));
        for limit in limits {
            let expected = oracle::best_split(costs, &cell, &references, limit);
            for set in InstructionSet::available() {
                let split = best_split(set, costs, &cell, &references, limit, &mut small);
                assert_eq!(split, expected, "{set:?} {round} {limit}");
            }
            found += usize::from(expected.is_some());
            rare += usize::from(expected.is_some_and(|split| split.planar_right));
        }
    }
    assert!(found > 4000 && rare > 50, "{found} {rare}");
}

#[test]
fn columns_are_sorted() {
    fn check<V: F32x16>(random: &mut Random, octets: usize) {
        let mut rows = vec![[0.0; WIDTH]; octets * OCTET];
        // Few values, so that many are equal.
        rows.as_flattened_mut().fill_with(|| random.below(20) as f32);
        let column = |rows: &[Row16], column: usize| -> Vec<f32> {
            (0..rows.len() * 2).map(place).map(|(row, half)| rows[row][half + column]).collect()
        };
        let mut expected: Vec<Vec<f32>> = (0..8).map(|k| column(&rows, k)).collect();
        expected.iter_mut().for_each(|column| column.sort_by(f32::total_cmp));
        sort::<V>(&mut rows);
        let sorted: Vec<Vec<f32>> = (0..8).map(|k| column(&rows, k)).collect();
        assert_eq!(sorted, expected);
    }
    let mut random = Random::new(3);
    for octets in 1..=MOST / 16 {
        for _ in 0..50 {
            check::<ArrayF32x16>(&mut random, octets);
            #[cfg(target_arch = "x86_64")]
            for set in InstructionSet::available() {
                match set {
                    InstructionSet::Avx2 => {
                        check::<<crate::simd::avx2::Avx2 as Simd>::F32x16>(&mut random, octets);
                    }
                    InstructionSet::Avx512 => {
                        check::<<crate::simd::avx512::Avx512 as Simd>::F32x16>(&mut random, octets);
                    }
                    _ => {}
                }
            }
        }
    }
}
