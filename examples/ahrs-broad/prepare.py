"""BROAD trials (.npz) -> tables of the contract, with two studies beside each: nine axes, and six.

python examples/ahrs-broad/prepare.py DATA OUT      DATA: a trial, or a folder of trials (each gets a folder in OUT)
schuler run OUT/TRIAL/study.toml                    with the magnetometer
schuler run OUT/TRIAL/study-6.toml                  without it
"""

import sys
from pathlib import Path

from schuler.ground.errors import InputError, SchulerError
from schuler.io.convert import convert
from schuler.io.formats import broad

SIX = """
[[outage]]                      # as if there were no magnetometer: the heading counts from the start
sensor = "magnetometer"
start_s = 0.0
end_s = 1e6
"""


def prepare(trial: Path, out: Path) -> None:
    """The tables of one trial and its studies."""
    report = convert(trial, out, format="broad")
    study = Path(__file__).with_name("study.toml").read_text(encoding="utf-8").replace("TRIAL", trial.stem)
    if "reference" not in report.rows:
        study = study.replace('reference = "reference.csv"', '# reference = "reference.csv"')
    (out / "study.toml").write_text(study, encoding="utf-8")
    six = study.replace(f'"{trial.stem}"', f'"{trial.stem} six axes"') + SIX
    (out / "study-6.toml").write_text(six, encoding="utf-8")
    for note in report.notes:
        print(f"note: {trial.stem}: {note}")
    print(f"now type:  schuler run {out / 'study.toml'}   or   schuler run {out / 'study-6.toml'}")


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        trials = sorted(p for p in data.glob("*.npz") if broad.recognise(p)) if data.is_dir() else [data]
        if not trials:
            raise InputError(f"{data} holds no BROAD trial (.npz with imu_gyr, imu_acc, opt_quat, sampling_rate)")
        for trial in trials:
            prepare(trial, out / trial.stem if data.is_dir() else out)
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
