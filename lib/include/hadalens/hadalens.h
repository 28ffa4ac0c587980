/* Hadalens: everything at once. The headers can also be included one by one; each says its threads, shapes, units,
 * ownership and errors. opencl.h, which needs the headers of OpenCL, is not among them. */
#ifndef HADALENS_HADALENS_H
#define HADALENS_HADALENS_H

#include <hadalens/base.h>
#include <hadalens/camera.h>
#include <hadalens/classic.h>
#include <hadalens/communicator.h>
#include <hadalens/dataset.h>
#include <hadalens/device.h>
#include <hadalens/emitters.h>
#include <hadalens/fit.h>
#include <hadalens/focus.h>
#include <hadalens/folder.h>
#include <hadalens/headerless.h>
#include <hadalens/image.h>
#include <hadalens/job.h>
#include <hadalens/limits.h>
#include <hadalens/lpips.h>
#include <hadalens/match.h>
#include <hadalens/metrics.h>
#include <hadalens/model.h>
#include <hadalens/monitor.h>
#include <hadalens/net.h>
#include <hadalens/optics.h>
#include <hadalens/pixels.h>
#include <hadalens/plot.h>
#include <hadalens/preview.h>
#include <hadalens/profile.h>
#include <hadalens/reconstruct.h>
#include <hadalens/register.h>
#include <hadalens/response.h>
#include <hadalens/scene.h>
#include <hadalens/sensor.h>
#include <hadalens/simulate.h>
#include <hadalens/status.h>
#include <hadalens/survey.h>
#include <hadalens/task_evaluate.h>
#include <hadalens/task_fit.h>
#include <hadalens/task_live.h>
#include <hadalens/task_optics.h>
#include <hadalens/task_reconstruct.h>
#include <hadalens/task_register.h>
#include <hadalens/task_simulate.h>
#include <hadalens/task_train.h>
#include <hadalens/tiff.h>
#include <hadalens/train.h>
#include <hadalens/tune.h>

#endif
