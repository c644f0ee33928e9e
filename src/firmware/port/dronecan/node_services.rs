//! Requests of other nodes. They wait until the module's state is known, and while the state machine executes a
//! command.

use super::firmware_update::UpdateForBootLoader;
use super::parameters;
use crate::wire::dronecan::outbound::{self, UpdateResult};
use crate::wire::dronecan::{
    BusMessage, DataType, InboundTransfer, NodeId, OutboundTransfer, ParameterOpcode, Payload, TransferKind,
};
use autoswing::time::Timestamp;
use autoswing_module::compass::Command;
use autoswing_module::messages::Refusal;
use autoswing_module::settings::{Setting, SettingValue, Settings};

/// Capacity of the queue, requests. While the queue is full, further ones are not answered, and their senders repeat
/// them.
const REQUEST_CAPACITY: usize = 4;

/// Timeout of a command, microseconds: longer than any save.
const RESULT_TIMEOUT_US: u64 = 2_000_000;

/// Node and transfer to which a response is sent.
#[derive(Clone, Copy, Debug)]
struct Requester {
    node: NodeId,
    priority: u8,
    transfer_id: u8,
}

impl Requester {
    fn response_transfer(self, (data_type, payload): (DataType, Payload)) -> OutboundTransfer {
        let Self { node, priority, transfer_id } = self;
        OutboundTransfer { data_type, priority, transfer_kind: TransferKind::Response(node), transfer_id, payload }
    }
}

/// Request without its requester.
#[derive(Clone, Copy, Debug)]
enum ServiceRequest {
    GetNodeInfo,
    GetTransportStats,
    Parameter { parameter: Option<&'static Setting>, value: Option<SettingValue> },
    Opcode(ParameterOpcode),
    Restart { is_confirmed: bool },
    Update(UpdateRequest),
}

/// Request for an update; the data of a valid one is in `Services::requested_update`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum UpdateRequest {
    Valid,
    /// The path of the update's file is invalid.
    Invalid,
    /// The board has no boot loader for updates over the bus.
    Unsupported,
    /// Another request for an update waits or is executed.
    AlreadyPending,
}

/// Command in execution for a requester.
#[derive(Clone, Copy, Debug)]
struct RunningCommand {
    started_at: Timestamp,
    command: Command,
    requester: Requester,
    request: ServiceRequest,
}

/// Next step with the oldest request.
pub(super) enum RequestStep {
    /// No request to answer.
    Idle,
    /// Send a response, then call [`Services::remove_answered_request`].
    Respond(OutboundTransfer),
    /// Execute a command, then call [`Services::complete_command`].
    Execute(Command),
}

/// Queue of requests.
#[derive(Debug, Default)]
pub(super) struct Services {
    refuses_updates: bool,
    waiting_requests: heapless::Deque<(Requester, ServiceRequest), REQUEST_CAPACITY>,
    running_command: Option<RunningCommand>,
    /// Request of an executed command, and its result, which is sent before all others.
    unanswered_result: Option<(Requester, ServiceRequest, Result<(), &'static str>)>,
    /// Requested update; one at a time.
    requested_update: Option<UpdateForBootLoader>,
    /// Update that the state machine has granted.
    granted_update: Option<UpdateForBootLoader>,
}

impl Services {
    /// Refuses all updates from now on.
    pub const fn refuse_updates(&mut self) {
        self.refuses_updates = true;
    }

    /// Queues a request.
    pub fn receive_transfer(&mut self, own_node: NodeId, transfer: &InboundTransfer<'_>) {
        let Some(node) = transfer.source_node.filter(|_| !self.waiting_requests.is_full()) else { return };
        let request = match transfer.message {
            BusMessage::GetNodeInfo => ServiceRequest::GetNodeInfo,
            BusMessage::GetTransportStats => ServiceRequest::GetTransportStats,
            BusMessage::GetSet(request) => {
                let parameter = parameters::requested_parameter(&request);
                let value = parameters::requested_value(request.value);
                ServiceRequest::Parameter { parameter, value }
            }
            BusMessage::ExecuteOpcode(opcode) => ServiceRequest::Opcode(opcode),
            BusMessage::RestartNode(is_confirmed) => ServiceRequest::Restart { is_confirmed },
            BusMessage::BeginFirmwareUpdate { server, path } => ServiceRequest::Update(
                self.register_update_request(UpdateForBootLoader::new(server.unwrap_or(node), own_node, path)),
            ),
            _ => return,
        };
        let requester = Requester { node, priority: transfer.priority, transfer_id: transfer.transfer_id };
        let _ = self.waiting_requests.push_back((requester, request));
    }

    fn register_update_request(&mut self, update: Option<UpdateForBootLoader>) -> UpdateRequest {
        match (&self.requested_update, update) {
            _ if self.refuses_updates => UpdateRequest::Unsupported,
            (Some(_), _) => UpdateRequest::AlreadyPending,
            (None, None) => UpdateRequest::Invalid,
            (None, update) => {
                self.requested_update = update;
                UpdateRequest::Valid
            }
        }
    }

    /// Whether no request waits, and none is executed.
    pub fn is_idle(&self) -> bool {
        self.unanswered_result.is_none() && self.running_command.is_none() && self.waiting_requests.is_empty()
    }

    /// Whether a request can be answered or executed.
    pub fn has_requests(&self) -> bool {
        self.unanswered_result.is_some() || (self.running_command.is_none() && !self.waiting_requests.is_empty())
    }

    /// Next step with the oldest request. `describe_node` returns the responses that only the node knows.
    pub fn next_request_step(
        &mut self,
        now: Timestamp,
        settings: &Settings,
        describe_node: impl Fn(DataType) -> Payload,
    ) -> RequestStep {
        if self.running_command.is_some_and(|open| now.us_since(open.started_at) > RESULT_TIMEOUT_US) {
            self.finish_request(Err("timeout"));
        }
        if let Some((requester, request, result)) = self.unanswered_result {
            return RequestStep::Respond(
                requester.response_transfer(response_after_command(request, result, settings)),
            );
        }
        let Some((requester, request)) = self.waiting_requests.front().copied() else { return RequestStep::Idle };
        match self.decide_request(request, settings, describe_node) {
            RequestDecision::Answer(data_type, payload) => {
                RequestStep::Respond(requester.response_transfer((data_type, payload)))
            }
            RequestDecision::Execute(_) if self.running_command.is_some() => RequestStep::Idle,
            RequestDecision::Execute(command) => {
                self.waiting_requests.pop_front();
                self.running_command = Some(RunningCommand { started_at: now, command, requester, request });
                RequestStep::Execute(command)
            }
        }
    }

    /// Removes the request after its response was queued.
    pub fn remove_answered_request(&mut self) {
        if self.unanswered_result.take().is_none() {
            self.waiting_requests.pop_front();
        }
    }

    /// Processes the result of a command; returns whether a request waited for it.
    pub fn complete_command(&mut self, command: Command, result: Result<(), &Refusal>) -> bool {
        let is_open = self.running_command.is_some_and(|open| open.command == command);
        if is_open {
            self.finish_request(result.map_err(Refusal::stable_code));
        }
        is_open
    }

    /// Whether the module is about to load another firmware.
    pub const fn is_updating(&self) -> bool {
        self.granted_update.is_some()
    }

    /// Granted update, to be handed over before the restart.
    pub const fn granted_update(&self) -> Option<&UpdateForBootLoader> {
        self.granted_update.as_ref()
    }

    fn decide_request(
        &mut self,
        request: ServiceRequest,
        settings: &Settings,
        describe_node: impl Fn(DataType) -> Payload,
    ) -> RequestDecision {
        let described = |data_type| RequestDecision::Answer(data_type, describe_node(data_type));
        match request {
            ServiceRequest::GetNodeInfo => described(DataType::GET_NODE_INFO),
            ServiceRequest::GetTransportStats => described(DataType::GET_TRANSPORT_STATS),
            ServiceRequest::Parameter { parameter, value } => {
                let change = parameter.zip(value).filter(|(parameter, value)| parameter.value(settings) != *value);
                change.and_then(|(parameter, value)| parameter.change_to(value)).map_or_else(
                    || RequestDecision::Answer(DataType::GET_SET, parameters::parameter_response(parameter, settings)),
                    |change| RequestDecision::Execute(Command::SetFromBus(change)),
                )
            }
            ServiceRequest::Opcode(ParameterOpcode::Erase) => RequestDecision::Execute(Command::ResetSettings),
            // A parameter is saved when it is set.
            ServiceRequest::Opcode(opcode) => RequestDecision::Answer(
                DataType::EXECUTE_OPCODE,
                outbound::opcode_result(opcode == ParameterOpcode::Save),
            ),
            ServiceRequest::Restart { is_confirmed: true } => RequestDecision::Execute(Command::Restart),
            ServiceRequest::Restart { is_confirmed: false } => {
                RequestDecision::Answer(DataType::RESTART_NODE, outbound::restart_result(false))
            }
            ServiceRequest::Update(request) => self.decide_update(request),
        }
    }

    fn decide_update(&mut self, request: UpdateRequest) -> RequestDecision {
        let (result, reason) = match request {
            UpdateRequest::AlreadyPending => (UpdateResult::InProgress, ""),
            UpdateRequest::Valid if self.is_updating() => {
                self.requested_update = None;
                (UpdateResult::InProgress, "")
            }
            UpdateRequest::Valid => return RequestDecision::Execute(Command::Restart),
            UpdateRequest::Unsupported => (UpdateResult::Unknown, "no boot loader for updates over CAN"),
            UpdateRequest::Invalid => (UpdateResult::Unknown, "a path has 1 to 200 characters"),
        };
        RequestDecision::Answer(DataType::BEGIN_FIRMWARE_UPDATE, outbound::update_result(result, reason))
    }

    /// Ends the open command.
    fn finish_request(&mut self, result: Result<(), &'static str>) {
        let Some(RunningCommand { requester, request, .. }) = self.running_command.take() else { return };
        if let ServiceRequest::Update(_) = request {
            self.granted_update = self.requested_update.take().filter(|_| result.is_ok());
        }
        self.unanswered_result = Some((requester, request, result));
    }
}

/// Response to a request after its command. A parameter is answered with the value that is then in force.
fn response_after_command(
    request: ServiceRequest,
    result: Result<(), &'static str>,
    settings: &Settings,
) -> (DataType, Payload) {
    match request {
        ServiceRequest::Parameter { parameter, .. } => {
            (DataType::GET_SET, parameters::parameter_response(parameter, settings))
        }
        ServiceRequest::Opcode(_) => (DataType::EXECUTE_OPCODE, outbound::opcode_result(result.is_ok())),
        ServiceRequest::Update(_) => {
            let (code, reason) = match result {
                Ok(()) => (UpdateResult::Ok, ""),
                Err(reason) => (UpdateResult::InvalidMode, reason),
            };
            (DataType::BEGIN_FIRMWARE_UPDATE, outbound::update_result(code, reason))
        }
        // Of these requests only `Restart` needs a command.
        ServiceRequest::Restart { .. } | ServiceRequest::GetNodeInfo | ServiceRequest::GetTransportStats => {
            (DataType::RESTART_NODE, outbound::restart_result(result.is_ok()))
        }
    }
}

/// Answer to a request, or the command that it needs.
enum RequestDecision {
    Answer(DataType, Payload),
    Execute(Command),
}
