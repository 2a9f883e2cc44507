//! Axes: from values to pixels, and where ticks stand so that their labels have room.

use crate::trade::payback::count;

/// How values are spread over an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm.
    Log,
    /// By their logarithm, and zero at the lower end, apart from the rest.
    LogAndZero,
}

/// Part of the length that zero has for itself.
const ZERO: f64 = 0.12;

/// An axis: values from `low` to `high` between two pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    pub(super) scale: Scale,
    low: f64,
    high: f64,
    start: f64,
    end: f64,
}

impl Axis {
    /// An axis that shows all of the values with some room at both ends: by their logarithm where
    /// they differ by more than a factor of eight.
    pub(super) fn around(values: &[f64], start: i32, end: i32) -> Axis {
        let usable = || values.iter().copied().filter(|x| x.is_finite());
        let (least, most) =
            usable().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let (least, most) = if least > most { (0.0, 1.0) } else { (least, most) };
        if least > 0.0 && most > 8.0 * least {
            let room = (most / least).powf(0.06);
            return Axis::new(Scale::Log, least / room, most * room, start, end);
        }
        let room = (0.08 * (most - least)).max(0.05 * most.abs()).max(1e-9);
        let low = if least >= 0.0 { (least - room).max(0.0) } else { least - room };
        Axis::new(Scale::Linear, low, most + room, start, end)
    }

    /// An axis by logarithms from a value to another, both above 0.
    pub(super) fn log(low: f64, high: f64, start: i32, end: i32) -> Axis {
        Axis::new(Scale::Log, low, high, start, end)
    }

    /// An axis of values of 0 or more, many of them 0.
    pub(super) fn with_zero(values: &[f64], start: i32, end: i32) -> Axis {
        let positive = || values.iter().copied().filter(|x| *x > 0.0 && x.is_finite());
        let least = positive().fold(f64::INFINITY, f64::min);
        let most = positive().fold(0.0, f64::max);
        let (least, most) = if least > most { (1.0, 10.0) } else { (least, most) };
        let low = 10f64.powf(least.log10().floor());
        Axis::new(Scale::LogAndZero, low, (most * 1.5).max(10.0 * low), start, end)
    }

    fn new(scale: Scale, low: f64, high: f64, start: i32, end: i32) -> Axis {
        Axis { scale, low, high, start: start.into(), end: end.into() }
    }

    /// The pixel of a value; what is beyond an end is at that end.
    pub(super) fn pixel(&self, value: f64) -> i32 {
        let log =
            |x: f64| (x.max(self.low).ln() - self.low.ln()) / (self.high.ln() - self.low.ln());
        let part = match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => log(value),
            Scale::LogAndZero if value <= 0.0 => 0.0,
            Scale::LogAndZero => ZERO + (1.0 - ZERO) * log(value),
        };
        let part = if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) };
        (self.start + part * (self.end - self.start)).round() as i32
    }

    /// Whether a value is on the axis.
    pub(super) fn holds(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// The value at a part of the length; of no use for zero apart.
    pub(super) fn value(&self, part: f64) -> f64 {
        match self.scale {
            Scale::Linear => self.low + part * (self.high - self.low),
            _ => (self.low.ln() + part * (self.high.ln() - self.low.ln())).exp(),
        }
    }

    /// Values for ticks, with their labels, at least `apart` pixels from one another.
    pub(super) fn ticks(&self, apart: i32) -> Vec<(i32, String)> {
        let mut values = match self.scale {
            Scale::Linear => self.even(apart),
            _ => self.by_decades(apart),
        };
        if values.len() < 2 && self.scale == Scale::Log {
            values = self.even(apart);
        }
        if self.scale == Scale::LogAndZero {
            values.insert(0, 0.0);
        }
        let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let mut ticks: Vec<(i32, String)> = Vec::new();
        for value in values {
            let pixel = self.pixel(value);
            if ticks.last().is_none_or(|(last, _)| (pixel - last).abs() >= apart) {
                ticks.push((pixel, label(value, step)));
            }
        }
        ticks
    }

    /// 1, 2 or 5 times a power of ten apart.
    fn even(&self, apart: i32) -> Vec<f64> {
        let length = (self.end - self.start).abs();
        let room = (self.high - self.low) * f64::from(apart) / length.max(1.0);
        if !(room > 0.0 && room.is_finite()) {
            return vec![self.low];
        }
        let decade = 10f64.powf(room.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|times| times * decade)
            .find(|step| *step >= room)
            .unwrap_or(10.0 * decade);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last.min(first + 100)).map(|i| i as f64 * step).collect()
    }

    /// Powers of ten, and 2 and 5 times these where there is room.
    fn by_decades(&self, apart: i32) -> Vec<f64> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let all = |times: &[f64], every: usize| -> Vec<f64> {
            (first..=last)
                .step_by(every)
                .flat_map(|power| times.iter().map(move |times| times * 10f64.powi(power)))
                .filter(|value| self.holds(*value))
                .collect()
        };
        let fits = |values: &Vec<f64>| {
            values.windows(2).all(|pair| (self.pixel(pair[1]) - self.pixel(pair[0])).abs() >= apart)
        };
        let fine = all(&[1.0, 2.0, 5.0], 1);
        if fits(&fine) {
            return fine;
        }
        (1..=12).map(|every| all(&[1.0], every)).find(fits).unwrap_or_default()
    }
}

/// A value as short as its distance from the next allows.
fn label(value: f64, step: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if value.abs() >= 1e4 {
        return count(value);
    }
    let decimals = if step.is_finite() && step > 0.0 && value.abs() >= step {
        (-step.log10().floor()).max(0.0)
    } else {
        (-value.abs().log10().floor()).max(0.0)
    };
    format!("{value:.*}", decimals as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::random::unit;

    #[test]
    fn ticks_have_room_and_are_on_the_axis() {
        for case in 0..2000u64 {
            let draw = |k: u64| unit(case, &[k]);
            let scale = 10f64.powf(12.0 * draw(0) - 6.0);
            let spread = 10f64.powf(3.0 * draw(1));
            let values: Vec<f64> = (0..5).map(|k| scale * (1.0 + spread * draw(2 + k))).collect();
            let axes = [
                Axis::around(&values, 100, 900),
                Axis::around(&values, 700, 80),
                Axis::with_zero(&values, 700, 80),
                Axis::log(scale, 100.0 * scale, 60, 500),
            ];
            for axis in axes {
                let ticks = axis.ticks(60);
                assert!(!ticks.is_empty(), "{axis:?}");
                for pair in ticks.windows(2) {
                    assert!((pair[1].0 - pair[0].0).abs() >= 60, "{axis:?} {ticks:?}");
                    assert_ne!(pair[0].1, pair[1].1, "{axis:?} {ticks:?}");
                }
                for &value in &values {
                    let pixel = f64::from(axis.pixel(value));
                    let (a, b) = (axis.start.min(axis.end), axis.start.max(axis.end));
                    assert!((a..=b).contains(&pixel), "{axis:?}");
                }
            }
        }
    }

    #[test]
    fn odd_values_have_an_axis() {
        for values in [&[][..], &[f64::NAN], &[0.0], &[5.0], &[0.0, 0.0], &[1e-30, 1e30]] {
            for axis in [Axis::around(values, 0, 500), Axis::with_zero(values, 0, 500)] {
                assert!(!axis.ticks(50).is_empty(), "{values:?}");
                assert!((0..=500).contains(&axis.pixel(f64::NAN)));
            }
        }
    }

    #[test]
    fn zero_stands_apart() {
        let axis = Axis::with_zero(&[0.0, 3.0, 50_000.0], 700, 100);
        assert_eq!(axis.pixel(0.0), 700);
        assert!(axis.pixel(3.0) < 700 - 60);
        assert_eq!(axis.ticks(30)[0], (700, "0".to_owned()));
    }
}
