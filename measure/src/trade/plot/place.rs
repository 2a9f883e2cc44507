//! Where labels of points go: beside them, over no other label, no marker and no line to a label.

/// A rectangle by its left, top, right and bottom pixel.
pub(super) type Rect = [i32; 4];

/// A label that has its place, and a point that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    /// The place of the point among the points.
    pub(super) point: usize,
    /// What the label covers.
    pub(super) rect: Rect,
    /// The end of a line from the point to it; none where it stands right beside it.
    pub(super) line: Option<(i32, i32)>,
}

/// Pixels around a marker's middle that are its own.
const MARKER: i32 = 8;
/// Pixels between labels.
const GAP: i32 = 2;
/// Distances that are tried, in pixels.
const DISTANCES: [i32; 14] = [13, 18, 25, 34, 45, 58, 75, 95, 120, 150, 190, 240, 300, 380];
/// Directions that are tried at each distance.
const DIRECTIONS: u32 = 24;

/// Places labels of the given sizes beside their points, one after the other, each at the nearest place
/// that is free: over no marker, no other label and no line to one. `points` are all markers, labelled or
/// not; `labels` are places in `points` with the size of their text. Where there is room, a label also
/// stays off `curves`, and its line off other labels. One that fits nowhere is left out.
pub(super) fn place(
    points: &[(i32, i32)],
    labels: &[(usize, (i32, i32))],
    curves: &[Vec<(i32, i32)>],
    frame: Rect,
) -> Vec<Placed> {
    let mut out: Vec<Placed> = Vec::new();
    for &(point, size) in labels {
        let at = points[point];
        let candidates = DISTANCES.into_iter().flat_map(|distance| {
            (0..DIRECTIONS).map(move |turn| {
                // To the upper right first, then to both sides of it in turns.
                let side = if turn % 2 == 0 { 1.0 } else { -1.0 };
                let angle = 0.8
                    + side * f64::from(turn.div_ceil(2)) * std::f64::consts::TAU
                        / f64::from(DIRECTIONS);
                candidate(at, size, distance, angle)
            })
        });
        let free = |(rect, _): &(Rect, Option<(i32, i32)>)| {
            within(*rect, frame)
                && !points.iter().any(|marker| overlap(*rect, around(*marker)))
                && !out.iter().any(|other| {
                    overlap(*rect, grown(other.rect))
                        || other.line.is_some_and(|end| crosses(points[other.point], end, *rect))
                })
        };
        let clear = |(_, line): &(Rect, Option<(i32, i32)>)| {
            let meets =
                |other: &Placed| line.is_some_and(|end| crosses(at, end, grown(other.rect)));
            !out.iter().any(meets)
        };
        let off_curves = |(rect, _): &(Rect, Option<(i32, i32)>)| {
            let meets = |curve: &Vec<(i32, i32)>| {
                curve.windows(2).any(|pair| crosses(pair[0], pair[1], *rect))
            };
            !curves.iter().any(meets)
        };
        let all: Vec<_> = candidates.filter(free).collect();
        let best = || all.iter().filter(|candidate| clear(candidate));
        let found = best().find(|best| off_curves(best)).or_else(|| best().next());
        let found = found.or(all.first()).copied();
        if let Some((rect, line)) = found {
            out.push(Placed { point, rect, line });
        }
    }
    out
}

/// A label in a direction from a point, its nearest side at a distance.
fn candidate(
    (x, y): (i32, i32),
    (width, height): (i32, i32),
    distance: i32,
    angle: f64,
) -> (Rect, Option<(i32, i32)>) {
    let (dx, dy) = (angle.cos(), -angle.sin());
    // The middle of the label, so that its box just keeps the distance.
    let reach = f64::from(distance);
    let middle = (
        f64::from(x) + dx * (reach + 0.5 * f64::from(width)),
        f64::from(y) + dy * (reach + 0.5 * f64::from(height)),
    );
    let (left, top) = (middle.0.round() as i32 - width / 2, middle.1.round() as i32 - height / 2);
    let rect = [left, top, left + width, top + height];
    // Up to the nearest point of the box.
    let end = (x.clamp(rect[0], rect[2]), y.clamp(rect[1], rect[3]));
    (rect, (distance > DISTANCES[1]).then_some(end))
}

fn around((x, y): (i32, i32)) -> Rect {
    [x - MARKER, y - MARKER, x + MARKER, y + MARKER]
}

fn grown([left, top, right, bottom]: Rect) -> Rect {
    [left - GAP, top - GAP, right + GAP, bottom + GAP]
}

fn within(inner: Rect, outer: Rect) -> bool {
    inner[0] >= outer[0] && inner[1] >= outer[1] && inner[2] <= outer[2] && inner[3] <= outer[3]
}

/// Whether two rectangles share a pixel.
pub(super) fn overlap(a: Rect, b: Rect) -> bool {
    a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3]
}

/// Whether a line between two pixels meets a rectangle.
pub(super) fn crosses(a: (i32, i32), b: (i32, i32), rect: Rect) -> bool {
    let (ax, ay) = (f64::from(a.0), f64::from(a.1));
    let (dx, dy) = (f64::from(b.0) - ax, f64::from(b.1) - ay);
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for (start, step, low, high) in [(ax, dx, rect[0], rect[2]), (ay, dy, rect[1], rect[3])] {
        let (low, high) = (f64::from(low) - start, f64::from(high) - start);
        if step == 0.0 {
            if low > 0.0 || high < 0.0 {
                return false;
            }
            continue;
        }
        let (one, other) = (low / step, high / step);
        enter = enter.max(one.min(other));
        leave = leave.min(one.max(other));
    }
    enter <= leave
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::random::{hash, unit};

    /// However the points lie, even all on one pixel: no label is lost, none covers a marker, another
    /// label or a line.
    #[test]
    fn labels_never_meet() {
        let frame = [90, 60, 900, 780];
        for case in 0..120u64 {
            let spread = [1.0, 20.0, 100.0, 700.0][(case % 4) as usize];
            let coordinate = |i: u64, k: u64, middle: f64| {
                (middle + spread * (unit(case, &[i, k]) - 0.5)) as i32
            };
            let points: Vec<(i32, i32)> =
                (0..40).map(|i| (coordinate(i, 0, 500.0), coordinate(i, 1, 420.0))).collect();
            let size =
                |i: usize| (if hash(case, &[i as u64, 5]).is_multiple_of(2) { 11 } else { 22 }, 18);
            let labels: Vec<(usize, (i32, i32))> = (0..24).map(|i| (i, size(i))).collect();
            let placed = place(&points, &labels, &[], frame);
            assert_eq!(placed.len(), labels.len(), "case {case}: a label is lost");
            let apart = case % 4 == 3;
            for (i, own) in placed.iter().enumerate() {
                assert!(within(own.rect, frame));
                assert!(!points.iter().any(|&marker| overlap(own.rect, around(marker))));
                for (j, other) in placed.iter().enumerate().filter(|(j, _)| *j != i) {
                    assert!(!overlap(own.rect, other.rect), "case {case}: {i} and {j}");
                    // A label placed later keeps off lines before it, and where points are apart lines
                    // also keep off labels.
                    if j < i || apart {
                        let line =
                            other.line.map(|end| crosses(points[other.point], end, own.rect));
                        assert_ne!(line, Some(true), "case {case}: the line of {j} crosses {i}");
                    }
                }
            }
        }
    }

    #[test]
    fn labels_stay_off_curves_where_they_can() {
        let frame = [0, 0, 400, 400];
        let curve = vec![(0, 170), (400, 170)];
        let labels = [(0, (12, 18))];
        let free = place(&[(200, 190)], &labels, &[], frame);
        assert!(crosses(curve[0], curve[1], free[0].rect), "else this tries nothing");
        let placed = place(&[(200, 190)], &labels, std::slice::from_ref(&curve), frame);
        assert!(!crosses(curve[0], curve[1], placed[0].rect));
        let everywhere: Vec<Vec<(i32, i32)>> =
            (0..100).map(|i| vec![(0, 4 * i), (400, 4 * i)]).collect();
        assert_eq!(place(&[(200, 190)], &labels, &everywhere, frame).len(), 1, "none is lost");
    }

    #[test]
    fn lines_meet_rectangles() {
        let rect = [10, 10, 20, 20];
        assert!(crosses((0, 15), (30, 15), rect) && crosses((15, 15), (16, 16), rect));
        assert!(crosses((15, 0), (15, 30), rect) && crosses((0, 0), (30, 30), rect));
        assert!(!crosses((0, 15), (9, 15), rect) && !crosses((0, 25), (30, 25), rect));
        assert!(!crosses((0, 12), (12, 0), rect));
    }
}
