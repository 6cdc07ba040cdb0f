"""An example or two of each command, which its help shows."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("ident demo",),
    "check": ("ident check --log recording.mcap", "ident check --urdf arm.urdf --log runs/*.csv"),
    "base": ("ident base --robot puma560", "ident base --urdf arm.urdf --json"),
    "fit": (
        "ident fit --urdf arm.urdf --log train.csv --validate test.csv --out result",
        "ident fit study.toml --method physical --essential --out result",
    ),
    "validate": ("ident validate --fit result/fit.json --validate other.csv",),
    "diagnose": ("ident diagnose --urdf arm.urdf --log train.csv --validate test.csv --out found",),
    "compare": ("ident compare found/before.fit.json found/after.fit.json --log other.csv",),
    "judge": ("ident judge result/fit.json", "ident judge result/fit.json --repair fit --out repaired"),
    "payload": ("ident payload --fit result/fit.json --log loaded.csv",),
    "simulate": ("ident simulate --urdf arm.urdf --seconds 20 --log train.csv --with stribeck:elbow:Fs=2,v_s=0.1",),
    "excite": ("ident excite --urdf arm.urdf --ground 0 --trajectory motion.csv --view motion.html --ros motion.yaml",),
    "plan": ("ident plan --robot puma560 --out plan",),
    "monitor": ("ident monitor --fit result/fit.json --log today.csv --strict",),
    "export": ("ident export result/fit.json identified.urdf", "ident export result/fit.json feedforward.c"),
    "completion": ('eval "$(ident completion bash)"',),
    "study-schema": ("ident study-schema -o study.schema.json",),
    "report": ("ident report result/fit.json -o report.html",),
}
