/* What the measure of a device's arithmetic and the host agree on. */
#ifndef SHARED_PEAKS_H
#define SHARED_PEAKS_H

/* Chains of multiply-adds side by side in a work-item: enough to hide their latency, few enough for the registers. */
#define HADA_PEAK_CHAINS 12

#endif
