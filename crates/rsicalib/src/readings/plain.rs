//! The numbers of a CSV text that is nothing but numbers.

/// Columns of a plain table of numbers; none on any doubt.
///
/// Plain is: rows of `columns` cells, `,` between cells, `\n` or `\r\n` after each row but perhaps
/// the last, nothing else after the rows but empty lines, and every cell a decimal number,
/// `[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?`, without spaces or quotes. Whoever reads the text cell by
/// cell finds the same numbers, to the bit.
#[must_use]
pub fn plain_numbers(text: &[u8], columns: usize) -> Option<Vec<Vec<f64>>> {
    let text = without_empty_lines(text);
    let lines = 1 + text.iter().filter(|&&byte| byte == b'\n').count();
    // A row is not shorter than its cells and what parts them, whatever the header promises.
    let rows = lines.min(text.len() / (2 * columns).max(1) + 1);
    let mut out = (0..columns).map(|_| Vec::with_capacity(rows)).collect::<Vec<_>>();
    for line in text.split(|&byte| byte == b'\n') {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        let mut cells = line.split(|&byte| byte == b',');
        for column in &mut out {
            column.push(number(cells.next()?)?);
        }
        if cells.next().is_some() {
            return None;
        }
    }
    Some(out)
}

/// A text without the ends of lines at its end.
fn without_empty_lines(text: &[u8]) -> &[u8] {
    let end = text.iter().rposition(|byte| !matches!(byte, b'\n' | b'\r'));
    &text[..end.map_or(0, |last| last + 1)]
}

/// Digits of a whole number that is a float to the last of them.
const EXACT: usize = 15;

/// A decimal number; none where the cell is anything else.
fn number(cell: &[u8]) -> Option<f64> {
    if !cell.is_empty() && cell.len() <= EXACT && cell.iter().all(u8::is_ascii_digit) {
        let whole = cell.iter().fold(0_u64, |sum, digit| 10 * sum + u64::from(digit - b'0'));
        return Some(whole as f64);
    }
    // The names of infinity and NaN have letters other than e.
    let plain = |b: &u8| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.' | b'e' | b'E');
    if !cell.iter().all(plain) {
        return None;
    }
    std::str::from_utf8(cell).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::{number, plain_numbers};

    #[test]
    fn a_cell_is_a_decimal_number_or_a_doubt() {
        for text in ["0", "4095", "007", "1.", ".5", "+1.5", "-2e3", "2E-3", "1e400"] {
            assert_eq!(number(text.as_bytes()), Some(text.parse().expect("a number")), "{text}");
        }
        assert_eq!(number(b"9007199254740993"), Some(9007199254740992.0)); // to even, IEEE 754
        for text in
            ["", " 1", "1 ", "1_0", "nan", "inf", "-inf", "0x1", "1e", "e5", ".", "+", "1-2", "--1"]
        {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn rows_have_as_many_cells_as_the_header() {
        let columns = |text: &str| plain_numbers(text.as_bytes(), 2);
        assert_eq!(columns("1,2\n3,4\r\n5,6\n\n"), Some(vec![vec![1., 3., 5.], vec![2., 4., 6.]]));
        for text in ["1,2\n3\n", "1,2\n3,4,5\n", "1,2\n\n3,4\n", "1,2\r3,4\n", "1,\n", ""] {
            assert_eq!(columns(text), None, "{text:?}");
        }
    }
}
