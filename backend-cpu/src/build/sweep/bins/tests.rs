use super::*;
use crate::build::sweep::oracle;
use crate::cancel::UNWATCHED;
use crate::memory::Memory;
use splitplane_test_support::random::Random;

#[test]
fn the_split_is_that_of_a_search_over_all() {
    let mut random = Random::new(8);
    let (memory, mut bins) = (AtomicMemory::new(Memory::default()), Bins::default());
    let mut found = 0;
    for round in 0..300 {
        let both = oracle::costs(&mut random);
        let costs = &both[round % 2];
        let count = 1 + random.below(if round % 10 == 0 { 2500 } else { 400 });
        let (cell, references) = oracle::node(&mut random, costs, count);
        if cell.area <= 0.0 {
            continue;
        }
        for limit in [f64::INFINITY, costs.leaf(cell.area, count as u32)] {
            let expected = oracle::best_split(costs, &cell, &references, limit);
            for set in InstructionSet::available() {
                let (memory, meter) = (&memory, &UNWATCHED);
                let (bins, references) = (&mut bins, &references);
                let split = best_split(set, costs, &cell, references, limit, bins, memory, meter);
                assert_eq!(split.unwrap(), expected, "{set:?} {round} {limit}");
            }
            found += usize::from(expected.is_some());
        }
    }
    assert!(found > 250, "{found}");
}

#[test]
fn many_tasks_find_what_one_finds() {
    let mut random = Random::new(9);
    let memory = AtomicMemory::new(Memory::default());
    let (mut one, mut many) = (Bins::default(), Bins::default());
    for round in 0..12 {
        let both = oracle::costs(&mut random);
        let costs = &both[round % 2];
        let count = 1 + random.below(6 * CHUNK);
        let (cell, references) = oracle::node(&mut random, costs, count);
        if cell.area <= 0.0 {
            continue;
        }
        for set in InstructionSet::available() {
            let search = BinSearch {
                set,
                costs,
                cell: &cell,
                references: &references,
                grid: Grid::new(&cell, MOST),
                limit: f64::INFINITY,
                memory: &memory,
                meter: &UNWATCHED,
            };
            let mut events = [0; 2];
            for (bins, events) in [&mut one, &mut many].into_iter().zip(&mut events) {
                lengthen(&memory, &mut bins.places, count, [0; 8]).unwrap();
                bins.faces = [[0; MOST]; 8];
                count_faces(set, &search.grid, &references, &mut bins.faces, &mut bins.places);
                let faces = bins.faces;
                search.count_parts(bins).unwrap();
                for axis in [0, 1, 2, 4, 5, 6] {
                    assert_eq!(bins.faces[axis], faces[axis]);
                }
                let limit = f64::INFINITY;
                *events = bound(set, bins, costs, &cell, &search.grid, count as u32, limit);
                lengthen(&memory, &mut bins.events, *events, 0).unwrap();
            }
            // Where no plane lies inside, no bin is open, and neither is evaluated.
            if one.open.is_empty() {
                assert!(many.open.is_empty());
                continue;
            }
            assert_eq!(search.sweep(&mut one), search.sweep_parts(&mut many, events[1]).unwrap());
        }
    }
}
