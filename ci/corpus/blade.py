"""Prints a module of blade-render as WGSL, as its Rust makes it: constants that `#use` names, and bindings by number."""

import pathlib
import re
import sys

# The values that its Rust gives: enumerations count up, flags are bits.
USED = {
    "DEBUG_MODE": "const DEBUG_MODE: bool = true;",
    "MAX_JOINTS_PER_DRAW": "const MAX_JOINTS_PER_DRAW: u32 = 64u;",
    "MAX_LOCAL_LIGHTS": "const MAX_LOCAL_LIGHTS: u32 = 8u;",
}
VARIABLE = re.compile(r"^var(<(?:storage|uniform)[^>]*>)? *(\w+) *:", re.MULTILINE)

file = pathlib.Path(sys.argv[1])
everything = "\n".join(path.read_text() for path in sorted(file.parent.rglob("*.wgsl")))
# Modules that are linked together number their variables together.
numbers = {name: at for at, name in enumerate(sorted({found[1] for found in VARIABLE.findall(everything)}))}


def constants(used):
    name = used.group(1)
    if name in USED:
        return USED[name]
    members = sorted(set(re.findall(rf"\b{name}_(\w+)", everything)))
    of = (lambda at: 1 << at) if name.endswith("Flags") else (lambda at: at)
    return " ".join(f"const {name}_{member}: u32 = {of(at)}u;" for at, member in enumerate(members))


text = re.sub(r"^#use (\w+)$", constants, file.read_text(), flags=re.MULTILINE)
enable = "enable wgpu_binding_array; " if "binding_array<" in text else ""
print(enable + VARIABLE.sub(lambda found: f"@group(0) @binding({numbers[found.group(2)]}) {found.group()}", text))
