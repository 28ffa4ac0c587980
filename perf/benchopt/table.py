#!/usr/bin/env python3
"""table.py FILE.parquet: a row for each method of a run of benchopt: its best PSNR, and when it was there."""
import sys

import pandas


def main():
    runs = pandas.read_parquet(sys.argv[1])
    print('| data | method | steps | s | PSNR (dB) | SSIM |\n|---|---|---|---|---|---|')
    for (data, solver), rows in runs.groupby(['dataset_name', 'solver_name']):
        curve = rows.groupby('stop_val')[['time', 'objective_psnr', 'objective_ssim']].median()
        best = curve['objective_psnr'].idxmax()
        print('| %s | %s | %d | %.2f | %.2f | %.3f |' % (data, solver, best, *curve.loc[best]))


if __name__ == '__main__':
    main()
