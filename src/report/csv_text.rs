//! Rows of fields as CSV text, numbers with a fixed count of decimals.

/// A CSV table with this header line; fields are quoted where they must be.
#[must_use]
pub fn csv_text(header: &str, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut writer = csv::WriterBuilder::new()
        .flexible(true)
        .from_writer(Vec::new());
    for row in rows {
        // Writing to memory cannot fail, and rows may have any length.
        let _ = writer.write_record(&row);
    }
    let body = writer.into_inner().unwrap_or_default();
    format!("{header}\n{}", String::from_utf8_lossy(&body))
}

/// A number with `decimals` decimals, never `-0`.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_quoted_where_they_must_be() {
        let row = vec!["a,b".to_owned(), "c \"d\"".to_owned(), String::new()];
        assert_eq!(
            csv_text("x,y,z", [row]),
            "x,y,z\n\"a,b\",\"c \"\"d\"\"\",\n"
        );
        assert_eq!(csv_text("x,y,z", []), "x,y,z\n");
    }

    #[test]
    fn there_is_no_negative_zero() {
        assert_eq!(fixed(-1e-9, 6), "0.000000");
        assert_eq!(fixed(-1.5, 1), "-1.5");
    }
}
