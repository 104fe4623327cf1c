// SPDX-License-Identifier: GPL-2.0-only OR Apache-2.0
// Gives a virtual USB host of the kernel what every real one has: a node in the firmware's tables. libcamera names a USB camera by
// its host's node and refuses a camera without one ("Can not find controller ID").
#include <linux/acpi.h>
#include <linux/module.h>
#include <linux/platform_device.h>

static char *host = "vhci_hcd.0";
module_param(host, charp, 0444);
MODULE_PARM_DESC(host, "the platform device that gets the node of the PCI host bridge");

static int __init firmware_node_init(void) {
  struct device *device = bus_find_device_by_name(&platform_bus_type, NULL, host);
  struct acpi_device *node = acpi_dev_get_first_match_dev("PNP0A03", NULL, -1);
  int error = device && node ? acpi_bind_one(device, node) : -ENODEV;
  if (node) acpi_dev_put(node);
  put_device(device);
  return error;
}
module_init(firmware_node_init);
MODULE_LICENSE("GPL");
