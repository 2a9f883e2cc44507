// Twin of `rounded` and `rounded_distance` in core/src/query/certify/record.rs: numbers known within an error, as the
// floats that they round to. Needs certain.wgsl.

// What adding to the low part of a number rounds away, per unit of it and of the error.
const ROUNDING: f32 = 0x1p-22f;
// Distances whose exponents are not between these, nor scaled, are left to the CPU.
const EXPONENT_LEAST: i32 = -100;
const EXPONENT_MOST: i32 = 99;

// A float, unless it may be another one.
struct Rounded {
    some: bool,
    value: f32,
}

// A number rounded to the nearest float.
fn rounded(value: Double, error: f32) -> Rounded {
    let reach = sum(error, product(sum(error, abs(value.low)), ROUNDING));
    let up = sum(value.high, sum(value.low, reach));
    let down = sum(value.high, difference(value.low, reach));
    return Rounded(up == value.high && down == value.high, value.high);
}

fn is_plain_exponent(power: i32) -> bool {
    return EXPONENT_LEAST <= power && power <= EXPONENT_MOST;
}

// A distance, in the ray's own units, as it is reported: the exact one rounded to nearest. `power` is that by which the
// ray's direction was divided.
fn rounded_distance(t: Double, error: f32, power: i32) -> Rounded {
    if error == 0.0 {
        // Exactly zero.
        return Rounded(true, 0.0);
    }
    let inner = rounded(t, error);
    let here = exponent(inner.value);
    let plain = is_plain_exponent(here) && is_plain_exponent(here - power);
    return Rounded(inner.some && plain, scale(inner.value, -power));
}
