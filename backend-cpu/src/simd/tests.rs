//! Each operation of each set against what its description says, lane by lane.

use splitplane_core::arithmetic::{Arithmetic, Strict};
use splitplane_test_support::random::Random;

use super::instruction_set::InstructionSet;
use super::*;

/// Few different ones, so that some are equal, and those that are no numbers among them.
fn float(random: &mut Random) -> f32 {
    match random.below(16) {
        0 => f32::NAN,
        1 => f32::INFINITY,
        2 => -0.0,
        3 => 0.0,
        k => k as f32 - 9.5,
    }
}

fn row(random: &mut Random) -> [f32; MOST_LANES] {
    [(); MOST_LANES].map(|()| float(random))
}

/// Numbers of all bits, subnormal and infinite ones among them.
fn wide_row(random: &mut Random) -> [f32; MOST_LANES] {
    [(); MOST_LANES].map(|()| f32::from_bits(random.bits()))
}

fn bits(row: &[f32]) -> Vec<u32> {
    row.iter().map(|x| if x.is_nan() { u32::MAX } else { x.to_bits() }).collect()
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn check<S: Simd>() {
    let mut random = Random::new(S::N as u64);
    for _ in 0..if cfg!(miri) { 20 } else { 2_000 } {
        let (x, y) = (row(&mut random), row(&mut random));
        // SAFETY: the caller's contract; rows have as many elements as any set has lanes.
        unsafe {
            let (a, b) = (S::load(x.as_ptr()), S::load(y.as_ptr()));
            let told = |floats: S::Floats| {
                let mut row = [0.0; MOST_LANES];
                S::store(row.as_mut_ptr(), floats);
                bits(&row[..S::N])
            };
            let each = |of: fn(f32, f32) -> f32| {
                bits(&(0..S::N).map(|i| of(x[i], y[i])).collect::<Vec<_>>())
            };
            assert_eq!(told(S::add(a, b)), each(|x, y| x + y));
            assert_eq!(told(S::sub(a, b)), each(|x, y| x - y));
            assert_eq!(told(S::mul(a, b)), each(|x, y| x * y));
            assert_eq!(told(S::div(a, b)), each(|x, y| x / y));
            assert_eq!(told(S::min(a, b)), each(|x, y| if x < y { x } else { y }));
            assert_eq!(told(S::max(a, b)), each(|x, y| if x > y { x } else { y }));
            assert_eq!(told(S::abs(a)), each(|x, _| x.abs()));
            assert_eq!(told(S::product_error(a, b)), each(|x, y| Strict::two_product(x, y).1));
            let (p, q) = (wide_row(&mut random), wide_row(&mut random));
            let error = S::product_error(S::load(p.as_ptr()), S::load(q.as_ptr()));
            let of = (0..S::N).map(|i| Strict::two_product(p[i], q[i]).1);
            assert_eq!(told(error), bits(&of.collect::<Vec<_>>()), "{p:?} {q:?}");
            let le = (0..S::N).fold(0, |bits, i| bits | u32::from(x[i] <= y[i]) << i);
            let mask = S::le(a, b);
            assert_eq!(S::bits(mask), le);
            let some = random.bits() & ((1 << S::N) - 1);
            assert_eq!(S::bits(S::mask(some)), some);
            assert_eq!(S::bits(S::and(mask, S::mask(some))), le & some);
            let chosen: Vec<f32> =
                (0..S::N).map(|i| if le >> i & 1 != 0 { x[i] } else { y[i] }).collect();
            assert_eq!(told(S::select(mask, a, b)), bits(&chosen));
            let kept: Vec<f32> =
                (0..S::N).map(|i| if le >> i & 1 != 0 { x[i] } else { 0.0 }).collect();
            assert_eq!(told(S::keep(mask, a)), bits(&kept));

            // The least of those that are numbers.
            let of = (0..S::N).fold(0, |bits, i| bits | u32::from(!x[i].is_nan()) << i) & some;
            let least = (0..S::N).filter(|i| of >> i & 1 != 0).map(|i| x[i]);
            let least = least.fold(f32::INFINITY, f32::min);
            let expected = (0..S::N).fold(0, |bits, i| bits | u32::from(x[i] == least) << i);
            assert_eq!(S::least(of, a) & of, expected & of);

            let real = x.map(|x| if x.is_nan() { 0.0 } else { x });
            let lowest = real[..S::N].iter().copied().fold(f32::INFINITY, f32::min);
            let highest = real[..S::N].iter().copied().fold(f32::NEG_INFINITY, f32::max);
            assert_eq!(S::lowest(S::load(real.as_ptr())), lowest);
            assert_eq!(S::highest(S::load(real.as_ptr())), highest);
            let mut to = [7.0; 2 * MOST_LANES];
            S::compress(a, some, to.as_mut_ptr().add(1));
            let chosen = (0..S::N).filter(|i| some >> i & 1 != 0).map(|i| x[i]).collect::<Vec<_>>();
            assert_eq!(bits(&to[1..][..chosen.len()]), bits(&chosen));
            assert_eq!((to[0], to[1 + S::N]), (7.0, 7.0));

            let lane = random.below(S::N);
            assert_eq!(bits(&[S::lane(a, lane)]), bits(&[x[lane]]));
            let names: [u32; MOST_LANES] = core::array::from_fn(|_| random.bits() % 3);
            let same = (0..S::N).map(|i| u32::from(names[i] == 1) << i).sum::<u32>();
            assert_eq!(S::equal(names.as_ptr(), 1), same);

            let places: [u8; MOST_LANES] = core::array::from_fn(|_| random.below(2 * S::N) as u8);
            let table = [&x[..S::N], &y[..S::N]].concat();
            let found: Vec<f32> = (0..S::N).map(|i| table[places[i] as usize]).collect();
            assert_eq!(told(S::look_up([a, b], S::places(places.as_ptr()))), bits(&found));
            let low: Vec<u8> = places.iter().map(|place| place % S::N as u8).collect();
            let found: Vec<f32> = low[..S::N].iter().map(|&place| x[place as usize]).collect();
            assert_eq!(told(S::look_up_low(a, S::places(low.as_ptr()))), bits(&found));
        }
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn check_stacks<S: Simd>() {
    let mut random = Random::new(S::N as u64 + 99);
    for _ in 0..if cfg!(miri) { 20 } else { 2_000 } {
        let children: [u32; MOST_LANES] = core::array::from_fn(|_| random.bits());
        let t = row(&mut random).map(|x| if x.is_nan() { 4.0 } else { x.min(99.0) });
        let mut order: [u8; MOST_LANES] = core::array::from_fn(|i| i as u8);
        random.shuffle(&mut order[..S::N]);
        let backwards = random.below(2) == 0;
        let direction = Direction::new(S::N, backwards);
        // Full and empty masks too.
        let mask = match random.below(8) {
            0 => 0,
            1 => (1 << S::N) - 1,
            _ => random.bits() & ((1 << S::N) - 1),
        };
        let mut places: Vec<usize> = order[..S::N].iter().map(|&i| i as usize).collect();
        if backwards {
            places.reverse();
        }
        places.retain(|i| mask >> i & 1 != 0);
        let (mut to, mut to_t) = ([7; 64], [7.0; 64]);
        // SAFETY: the caller's contract; rows are long enough.
        unsafe {
            let floats = S::load(t.as_ptr());
            let last = S::push(
                children.as_ptr(),
                floats,
                S::mask(mask),
                order.as_ptr(),
                &direction,
                to.as_mut_ptr().add(3),
                to_t.as_mut_ptr().add(3),
            );
            assert_eq!((to[..3].to_vec(), to[3 + S::N]), (vec![7; 3], 7));
            for (k, &place) in places.iter().enumerate() {
                assert_eq!((to[3 + k], to_t[3 + k]), (children[place], t[place]));
            }
            if let Some(&place) = places.last() {
                assert_eq!(last, children[place]);
            }
            let mut pairs = [[7; 2]; 64];
            S::push_pairs(floats, children.as_ptr(), mask, pairs.as_mut_ptr().add(3));
            assert_eq!((pairs[..3].to_vec(), pairs[3 + S::N]), (vec![[7; 2]; 3], [7; 2]));
            for (k, place) in (0..S::N).filter(|i| mask >> i & 1 != 0).enumerate() {
                assert_eq!(pairs[3 + k], [t[place].to_bits(), children[place]]);
            }

            // Entered at `t`, left at others: the same as pushing those that are met.
            let exit = row(&mut random);
            let met: u32 = (0..S::N).map(|i| u32::from(t[i] <= exit[i]) << i).sum();
            let places: Vec<usize> = order[..S::N].iter().map(|&i| i as usize).collect();
            let places: Vec<usize> =
                if backwards { places.into_iter().rev().collect() } else { places };
            let places: Vec<usize> = places.into_iter().filter(|i| met >> i & 1 != 0).collect();
            let (last, some) = S::push_met(
                children.as_ptr(),
                floats,
                S::load(exit.as_ptr()),
                order.as_ptr(),
                &direction,
                to.as_mut_ptr().add(3),
                to_t.as_mut_ptr().add(3),
            );
            assert_eq!(some, places.len());
            for (k, &place) in places.iter().enumerate() {
                assert_eq!((to[3 + k], to_t[3 + k]), (children[place], t[place]));
            }
            if let Some(&place) = places.last() {
                assert_eq!(last, children[place]);
            }

            // For a ray alone: what was there before where none is met, and what follows another entry.
            let (mut to, mut to_t) = ([7; 64], [7.0; 64]);
            let exit = if random.below(4) == 0 { [f32::NEG_INFINITY; MOST_LANES] } else { exit };
            let places: Vec<usize> = places.into_iter().filter(|&i| t[i] <= exit[i]).collect();
            let (next, some) = S::push_met_alone(
                children.as_ptr(),
                floats,
                S::load(exit.as_ptr()),
                order.as_ptr(),
                &direction,
                to.as_mut_ptr().add(3),
                to_t.as_mut_ptr().add(3),
            );
            assert_eq!((to[..3].to_vec(), to[3 + S::N], some), (vec![7; 3], 7, places.len()));
            for (k, &place) in places.iter().enumerate() {
                assert_eq!((to[3 + k], to_t[3 + k]), (children[place], t[place]));
            }
            assert_eq!(next, places.last().map_or(7, |&place| children[place]));

            let rows =
                [row(&mut random), row(&mut random)].map(|row| [row[0], row[1], row[2], row[3]]);
            let from: [u32; 8] = core::array::from_fn(|_| random.below(8) as u32);
            let mut picked = [0.0; 8];
            S::pick(rows.map(F32x4::of), &from, &mut picked);
            let expected = from.map(|place| rows.as_flattened()[place as usize]);
            assert_eq!(bits(&picked), bits(&expected));

            let count = random.below(41);
            let mut t: [f32; 64] = core::array::from_fn(|_| float(&mut random));
            let mut names: [u32; 64] = core::array::from_fn(|i| i as u32);
            let stop = random.below(7) as f32 - 3.0;
            let kept: Vec<u32> = (0..count as u32).filter(|&i| t[i as usize] <= stop).collect();
            let end = S::cull(names.as_mut_ptr(), t.as_mut_ptr(), count, stop);
            assert_eq!(names[..end], kept);
            assert!(t[..end].iter().all(|&t| t <= stop));

            let from: Vec<f32> = (0..S::N * 20).map(|i| i as f32).collect();
            let mut to = vec![0.0; S::N * 18];
            S::transpose(from.as_ptr(), 20, to.as_mut_ptr(), 18);
            for (i, k) in (0..S::N).flat_map(|i| (0..S::N).map(move |k| (i, k))) {
                assert_eq!(to[k * 18 + i], from[i * 20 + k]);
            }
        }
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn check_columns<S: Simd>() {
    let mut random = Random::new(S::N as u64 + 7);
    for _ in 0..if cfg!(miri) { 20 } else { 500 } {
        let columns = 2 + random.below(4);
        let mut from = [(); 5].map(|()| [(); MOST_LANES].map(|()| random.bits()));
        let mut to = [[7; 96]; 5];
        let (left, right) = (3 + random.below(9), 40 + random.below(9));
        let side = match random.below(8) {
            0 => 0,
            1 => (1 << S::N) - 1,
            _ => random.bits() & ((1 << S::N) - 1),
        };
        let sources = from.each_mut().map(|column| column.as_mut_ptr());
        let targets = to.each_mut().map(|column| column.as_mut_ptr());
        // SAFETY: the caller's contract; columns are long enough.
        unsafe { S::split(side, &sources[..columns], &targets, left, right) };
        for (from, to) in from.iter().zip(&to[..columns]) {
            let of = |is_left: u32| (0..S::N).filter(move |i| side >> i & 1 == is_left);
            for (start, is_left) in [(left, 1), (right, 0)] {
                let expected: Vec<u32> = of(is_left).map(|i| from[i]).collect();
                assert_eq!(to[start..][..expected.len()], expected);
                assert_eq!([to[start - 1], to[start + S::N]], [7; 2]);
            }
        }
        assert_eq!(to[columns..], [[7; 96]; 5][columns..]);

        // Few numbers, so that keys tie in their upper halves.
        let numbers = [(); MOST_LANES].map(|()| random.below(5) as f32);
        let points: [u32; MOST_LANES] = core::array::from_fn(|_| random.bits());
        let mut keys = LeastKeys([(); 8].map(|()| key_of(random.below(6) as f32, random.bits())));
        keys.0.sort_unstable();
        let near = random.bits() & 0xffff;
        let mut expected = keys.0.to_vec();
        let near_lanes = (0..MOST_LANES).filter(|lane| near >> lane & 1 != 0);
        expected.extend(near_lanes.map(|lane| key_of(numbers[lane], points[lane])));
        expected.sort_unstable();
        // SAFETY: the caller's contract; rows have as many numbers as there are bits.
        unsafe { S::keep_least(&mut keys, numbers.as_ptr(), points.as_ptr(), near) };
        assert_eq!(keys.0, expected[..8]);
    }
}

/// Stacks of the tree over instances, whose nodes have eight children whatever the set.
///
/// # Safety
/// The processor must have the set, which must have eight lanes.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn check_nearest_last<S: Simd>() {
    const BEFORE: usize = 3;
    let mut random = Random::new(23);
    // Near enough to be exchanged.
    let near = |t: f32| t.abs() * (1.0 / f32::from(1u16 << 10).powi(2)) + 8.0 * f32::from_bits(1);
    let (mut in_order, mut equal) = (0, 0);
    for round in 0..if cfg!(miri) { 20 } else { 20_000 } {
        let of = |random: &mut Random| match round % 4 {
            // Of every size, of which some are equal.
            0 => random.pick(&[0.0, -0.0, 1.0, -1.0, 3.5, 1e-38, -1e-45, f32::MAX, -f32::MAX]),
            // Finite ones of all bits.
            1 => Some(f32::from_bits(random.bits())).filter(|t| t.is_finite()).unwrap_or(0.0),
            // Next to one another.
            2 => f32::from_bits(1.5f32.to_bits() + random.below(40) as u32),
            _ => random.between(-10.0, 10.0) as f32,
        };
        let mut t = [f32::NAN; MOST_LANES];
        let met = random.bits() & 0xff;
        for (lane, t) in t[..8].iter_mut().enumerate() {
            // What is not met may be anything.
            *t = if met >> lane & 1 != 0 { of(&mut random) } else { float(&mut random) };
        }
        let is_met: [f32; MOST_LANES] = core::array::from_fn(|lane| (met >> lane & 1) as f32);
        let children: [u32; MOST_LANES] = core::array::from_fn(|_| random.bits());
        let (mut to, mut to_t) = ([7u32; 24], [7.0f32; 24]);
        // SAFETY: the caller's contract; rows have as many elements as any set has lanes, and there is room for eight.
        let count = unsafe {
            let mask = S::le(S::splat(1.0), S::load(is_met.as_ptr()));
            let (to, to_t) = (to.as_mut_ptr().add(BEFORE), to_t.as_mut_ptr().add(BEFORE));
            S::push_nearest_last(children.as_ptr(), S::load(t.as_ptr()), mask, to, to_t)
        };
        assert_eq!(count, met.count_ones() as usize);
        assert_eq!((&to[..BEFORE], &to_t[..BEFORE]), (&[7; BEFORE][..], &[7.0; BEFORE][..]));
        assert_eq!((&to[BEFORE + 8..], &to_t[BEFORE + 8..]), (&[7; 13][..], &[7.0; 13][..]));
        // Each child with the `t` that it had, once.
        let told = to[BEFORE..][..count].iter().zip(&to_t[BEFORE..][..count]);
        let mut told: Vec<(u32, u32)> = told.map(|(child, t)| (*child, t.to_bits())).collect();
        let lanes = (0..8).filter(|lane| met >> lane & 1 != 0);
        let mut expected: Vec<(u32, u32)> =
            lanes.map(|lane| (children[lane], t[lane].to_bits())).collect();
        told.sort_unstable();
        expected.sort_unstable();
        assert_eq!(told, expected, "{t:?} {met:08b}");
        for pair in to_t[BEFORE..][..count].windows(2) {
            assert!(pair[0] >= pair[1] - near(pair[1]), "{t:?} {met:08b}: {to_t:?}");
            in_order += usize::from(pair[0] > pair[1] + near(pair[1]));
            equal += usize::from(pair[0].to_bits() == pair[1].to_bits());
        }
    }
    assert!(cfg!(miri) || (in_order > 10_000 && equal > 1_000), "{in_order} {equal}");
}

struct Operations;

impl Compiled for Operations {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        // SAFETY: the caller's contract.
        unsafe {
            check::<S>();
            check_stacks::<S>();
            check_columns::<S>();
            check_nearest_last::<S::Eight>();
        }
    }
}

#[test]
fn sets_do_what_is_said() {
    for set in InstructionSet::available() {
        // SAFETY: the processor has it.
        unsafe { set.run(Operations) };
    }
    // SAFETY: plain Rust.
    unsafe { portable::Portable::call(Operations) };
}
