#!/usr/bin/env bash
# The first signal ends every command in every stage: what is left then takes 2 s of two cores at most, by processor
# time, since machines are shared. What takes longer is tried twice, and more often while it compiles kernels.
# MOMENTS="SECONDS...": when signals are sent; nightly takes more of them.
. "$(dirname "$0")/cli_testing.sh"
expect 0 '' simulate --preset sim300 --channels 1 --pairs 4 --test 1 -o set
expect 0 '' fit set -o m
"$FRAME_TOOL" lpips alex.safetensors
"$FRAME_TOOL" flat large.tif 1000 1200 1 0.5
python3 - "$HADALENS" ${MOMENTS:-0.3 1.5} <<'PYTHON' || fail 'a signal was not met'
import glob, os, shutil, signal, subprocess, sys, time
frames = sorted(glob.glob('set/**/raw/*.tif', recursive=True))
commands = [['simulate', '--preset', 'sim512', '--pairs', '1000', '-o', 'x'],
            ['optics', '--preset', 'sim512', '--mask', 'diffuser', '--depths', '256', '-o', 'x'],
            ['optics', '--preset', 'sim512', '--optics', 'wave', '--depths', '256', '-o', 'x'],
            ['fit', 'set', '-o', 'x'],
            ['reconstruct', *frames, '-m', 'm', '-o', 'x', '--queues', '2'],
            ['reconstruct', *frames, '-m', 'm', '-o', 'x', '--method', 'admm', '--iterations', '10000'],
            ['train', 'set', '-m', 'm', '-o', 'x', '--log', 'y', '--steps', '1000000'],
            ['register', 'set', '--rotation', '3', '-o', 'x'],
            ['tune', '-o', 'x', '--rounds', '1000', '--size', '1024x1024'],
            ['bench', '--quick', '-o', 'x'],
            ['devices', '--save-binaries', 'x'],
            ['evaluate', 'large.tif', 'large.tif', '--lpips', 'alex.safetensors']]

def left(command, moment, number):
    """Processor seconds from the signal to the end; nearly none where the command had ended."""
    for name in 'xy':
        shutil.rmtree(name, ignore_errors=True) if os.path.isdir(name) else os.path.exists(name) and os.unlink(name)
    process = subprocess.Popen([sys.argv[1], *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(moment)
    with open(f'/proc/{process.pid}/stat') as stat:
        before = sum(map(int, stat.read().rsplit(')', 1)[1].split()[11:13])) / os.sysconf('SC_CLK_TCK')
    os.kill(process.pid, number) # not send_signal(), which may take the end from wait4()
    _, status, used = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    assert code in (0, 130), f'exit code {code}: {command}'
    return used.ru_utime + used.ru_stime - before

def compiled():
    return [sorted(glob.glob(os.environ[name] + '/**', recursive=True)) for name in ('POCL_CACHE_DIR', 'HADALENS_CACHE')]

for command in commands:
    for number, moment in enumerate(map(float, sys.argv[2:])):
        seconds = []
        while not seconds or seconds[-1] > 4 and (len(seconds) < 2 or len(seconds) < 20 and compiled() != before):
            before = compiled()
            seconds.append(left(command, moment, (signal.SIGTERM, signal.SIGINT)[number % 2]))
        print(command[0], moment, seconds, flush=True)
        assert seconds[-1] < 4, (command[0], moment, seconds)
PYTHON
finish
