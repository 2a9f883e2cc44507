//! Which settings no other setting beats.

/// Which of the points are optimal in the sense of Pareto: no other is at most as great in every
/// coordinate and less in one. Equal points do not beat each other. A point with a NaN is never
/// optimal and beats none.
pub fn optimal<const N: usize>(points: &[[f64; N]]) -> Vec<bool> {
    let valid = |point: &[f64; N]| point.iter().all(|x| !x.is_nan());
    let beats = |a: &[f64; N], b: &[f64; N]| {
        a.iter().zip(b).all(|(a, b)| a <= b) && a.iter().zip(b).any(|(a, b)| a < b)
    };
    // In lexicographic order whatever beats a point comes before it, and among those that beat it one
    // is optimal itself: comparing with the optimal ones found so far is enough.
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| valid(&points[i])).collect();
    order.sort_by(|&a, &b| {
        let pairs = points[a].iter().zip(&points[b]);
        pairs.map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne()).unwrap_or(a.cmp(&b))
    });
    let mut front: Vec<usize> = Vec::new();
    for i in order {
        if !front.iter().any(|&j| beats(&points[j], &points[i])) {
            front.push(i);
        }
    }
    let mut out = vec![false; points.len()];
    for i in front {
        out[i] = true;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::hash;

    /// By the definition, every pair.
    fn by_definition<const N: usize>(points: &[[f64; N]]) -> Vec<bool> {
        let beaten = |i: usize| {
            (0..points.len()).any(|j| {
                (0..N).all(|k| points[j][k] <= points[i][k])
                    && (0..N).any(|k| points[j][k] < points[i][k])
            })
        };
        (0..points.len()).map(|i| !beaten(i) && points[i].iter().all(|x| !x.is_nan())).collect()
    }

    #[test]
    fn a_staircase() {
        let points = [[1.0, 4.0], [2.0, 2.0], [4.0, 1.0], [3.0, 3.0], [2.0, 2.0], [1.0, 5.0]];
        assert_eq!(optimal(&points), [true, true, true, false, true, false]);
        assert_eq!(optimal(&[[0.0, -0.0], [-0.0, 0.0]]), [true, true]);
        assert_eq!(optimal(&[[f64::NAN, 0.0], [1.0, 1.0]]), [false, true]);
        assert_eq!(optimal::<3>(&[]), Vec::<bool>::new());
    }

    /// Few values, so that ties and equal points are common; marks equal the definition, somebody is
    /// always optimal, and the order of the points does not matter.
    #[test]
    fn equals_the_definition_whatever_the_points() {
        for case in 0..3000u64 {
            let count = (hash(case, &[0]) % 12) as usize;
            let values = 2 + hash(case, &[1]) % 4;
            let mut points: Vec<[f64; 4]> = (0..count as u64)
                .map(|i| std::array::from_fn(|k| (hash(case, &[2, i, k as u64]) % values) as f64))
                .collect();
            if case % 7 == 0 && count > 0 {
                points[0][1] = if case % 2 == 0 { f64::NAN } else { f64::INFINITY };
            }
            let found = optimal(&points);
            assert_eq!(found, by_definition(&points), "{points:?}");
            let any_valid = points.iter().any(|p| p.iter().all(|x| !x.is_nan()));
            assert_eq!(found.contains(&true), any_valid);
            points.reverse();
            let mut turned = optimal(&points);
            turned.reverse();
            assert_eq!(turned, found);
        }
    }
}
