use super::*;

#[test]
fn tiles_of_all_levels_are_counted() {
    let count = |levels, round_up, width, height| {
        Tiles { width: 8, height: 4, levels, round_up }.count(width, height)
    };
    assert_eq!(count(Levels::One, false, 16, 9), 2 * 3);
    // The levels are 16 x 9, 8 x 4, 4 x 2, 2 x 1 and 1 x 1. With sizes rounded up, they are 16 x 9, 8 x 5 and so on.
    assert_eq!(count(Levels::Mip, false, 16, 9), 6 + 1 + 1 + 1 + 1);
    assert_eq!(count(Levels::Mip, true, 17, 9), 9 + 4 + 1 + 1 + 1 + 1);
    // The levels combine the widths 16, 8, 4, 2, 1 with the heights 9, 4, 2, 1.
    assert_eq!(count(Levels::Rip, false, 16, 9), (2 + 1 + 1 + 1 + 1) * (3 + 1 + 1 + 1));
    assert_eq!(count(Levels::Rip, false, 1, 1), 1);
}

#[test]
fn texts_are_utf_8_or_latin_1_and_names_can_be_printed() {
    assert_eq!(text("größer →".as_bytes()), "größer →");
    assert_eq!(text(b"gr\xf6\xdfer"), "größer");
    assert_eq!(shown("a\0\x1b[31m"), "a\\0\\u{1b}[31m");
    assert_eq!(shown(&"x".repeat(1000)).len(), 64);
}
