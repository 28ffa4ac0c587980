/* Whether a process still gets on, told without the clock of a machine that others keep busy. */
#ifndef HADA_TESTS_FAULT_WATCH_H
#define HADA_TESTS_FAULT_WATCH_H

/* From now on SIGALRM ends this process where it took more than `most` seconds of processor time, or next to none in
 * `look` seconds of the clock: it waits for something that does not come. It is looked at every `look` seconds. */
void fault_watch(unsigned most, unsigned look);

/* Whether another thread of this process runs, waits for a processor or for a disk; 0 where the system does not tell.
 */
int fault_others_work(void);

#endif
