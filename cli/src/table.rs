//! Numbers and bars in columns.

/// Columns of the longest bar.
const WIDTH: f64 = 44.0;
/// A cell of a bar, by eighths.
const EIGHTHS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];

/// `1,234,567`.
pub(super) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// `512 B`, `1.5 KiB`, `20.0 MiB`.
pub(super) fn bytes(count: u64) -> String {
    let mut amount = count as f64;
    for unit in ["B", "KiB", "MiB", "GiB"] {
        // What would be shown as 1024.0 is 1.0 of the next.
        if amount < 1023.95 {
            return if unit == "B" { format!("{count} B") } else { format!("{amount:.1} {unit}") };
        }
        amount /= 1024.0;
    }
    format!("{amount:.1} TiB")
}

/// `37.5 %`; 0 of nothing.
pub(super) fn percent(part: f64, whole: f64) -> String {
    let percent = if whole > 0.0 { 100.0 * part / whole } else { 0.0 };
    format!("{percent:.1} %")
}

/// A row a number: its name, the number, its part of the sum, and a bar. Whatever is not zero has a
/// bar.
pub(super) fn bars(rows: &[(String, u64)]) -> String {
    let most = rows.iter().map(|(_, count)| *count).max().unwrap_or(0).max(1);
    let sum: u64 = rows.iter().map(|(_, count)| count).sum();
    let mut text = String::new();
    for (name, count) in rows {
        let eighths = (*count as f64 / most as f64 * WIDTH * 8.0).round() as usize;
        let eighths = if *count > 0 { eighths.max(1) } else { 0 };
        let bar = "█".repeat(eighths / 8) + EIGHTHS[eighths % 8];
        let part = percent(*count as f64, sum as f64);
        let line = format!("  {name:>13}{:>13}{part:>9}  {bar}", grouped(*count));
        text += line.trim_end();
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_groups() {
        for (number, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_234_567, "1,234,567")] {
            assert_eq!(grouped(number), text);
        }
    }

    #[test]
    fn bytes_in_units() {
        let wanted = [
            (0, "0 B"),
            (1023, "1023 B"),
            (1536, "1.5 KiB"),
            ((1 << 20) - 1, "1.0 MiB"),
            (3 << 30, "3.0 GiB"),
            (1 << 40, "1.0 TiB"),
        ];
        for (count, text) in wanted {
            assert_eq!(bytes(count), text);
        }
    }

    #[test]
    fn bars_are_in_proportion_and_none_is_lost() {
        let rows = [("a".to_owned(), 88), ("b".to_owned(), 11), ("c".to_owned(), 0)];
        let text = bars(&rows);
        let lengths: Vec<usize> = text.lines().map(|line| line.matches('█').count()).collect();
        assert_eq!(lengths, [44, 5, 0]);
        assert!(text.lines().nth(1).unwrap().ends_with('▌'), "{text}");
        let tiny = bars(&[("a".to_owned(), 1_000_000), ("b".to_owned(), 1)]);
        assert!(tiny.lines().nth(1).unwrap().ends_with('▏'), "{tiny}");
        assert_eq!(bars(&[]), "");
    }
}
