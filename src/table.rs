//! Tables on a terminal.

use comfy_table::{CellAlignment, Row, Table};

/// A line under the header and nothing else.
const RULED: &str = "     ──            ";

/// A table of words.
pub fn words(header: impl Into<Row>) -> Table {
    let mut table = Table::new();
    table.load_preset(RULED).set_header(header);
    table
}

/// A table whose columns after the first are numbers, which line up on the right.
pub fn numbers(header: impl Into<Row>) -> Table {
    let mut table = words(header);
    align_numbers(&mut table);
    table
}

/// Lines the columns after the first up on the right.
pub fn align_numbers(table: &mut Table) {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

/// A number with at most three digits behind the point, without trailing zeros.
pub fn number(x: f64) -> String {
    let rounded = format!("{x:.3}");
    rounded.trim_end_matches('0').trim_end_matches('.').to_owned()
}
