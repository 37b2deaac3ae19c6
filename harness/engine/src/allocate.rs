//! Which registers values share.

use crate::code::Code;

pub(crate) fn allocated(code: Code) -> Code {
    code
}
