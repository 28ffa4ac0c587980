#include "image/rank.h"

/* Brings the value of rank k to its place (C. A. R. Hoare's selection, pivot from the middle). */
float hada_select_rank(float *values, size_t count, size_t k)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        const float pivot = values[low + (high - low) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (values[i] < pivot)
                i++;
            while (values[j] > pivot)
                j--;
            if (i >= j)
                break;
            const float swap = values[i];
            values[i++] = values[j];
            values[j--] = swap;
        }
        /* values[low .. i-1] <= pivot <= values[i .. high], with values[i] = pivot where i == j */
        if (i == j) {
            if (k == i)
                return values[k];
            if (k < i)
                high = i - 1;
            else
                low = i + 1;
        } else if (k < i) {
            high = i - 1;
        } else {
            low = i;
        }
    }
    return values[k];
}
