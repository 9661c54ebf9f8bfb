//! Tables for notebooks.

/// A number for a table.
pub fn figure(value: f64) -> String {
    match value.abs() {
        size if size == 0.0 || (1e-3..1e5).contains(&size) => format!("{value:.5}"),
        size if size.is_finite() => format!("{value:.3e}"),
        _ => value.to_string(),
    }
}

/// A table for a notebook.
pub fn html_table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let row = |tag: &str, cells: &[String]| {
        let escape =
            |text: &String| text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let cells: Vec<String> =
            cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
        format!("<tr>{}</tr>", cells.concat())
    };
    let head: Vec<String> = head.iter().map(|&text| text.into()).collect();
    let body: Vec<String> = rows.map(|cells| row("td", &cells)).collect();
    format!("<table><thead>{}</thead><tbody>{}</tbody></table>", row("th", &head), body.concat())
}
